"""Sweeps on a Ray cluster of two node processes: the same rows as on this machine's processes."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from ray.cluster_utils import Cluster

from dvr_jax.dataset.labelling import LabelOptions
from dvr_jax.dataset.labels import sort_labels
from dvr_jax.dataset.shards import list_shards, read_shard
from dvr_jax.planning.label_workers import label_scenes
from dvr_jax.scene.files import save_scenes
from dvr_jax.scene.sampling import sample_scenes

SCENES = tuple(sample_scenes(4, 1, 4))


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    # The head has no CPU to give: what is labelled is labelled by the other node.
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    yield cluster
    cluster.shutdown()


def sweep(scenes: Path, out: Path, address: str) -> "subprocess.CompletedProcess[str]":
    options = ["--k-max", "2", "--solutions", "2", "--shard", "1", "--ray", address]
    command = [
        sys.executable,
        "-m",
        "dvr_jax.sweep",
        "--scenes",
        str(scenes),
        "--out",
        str(out),
        *options,
    ]
    return subprocess.run(command, capture_output=True, text=True)


def test_two_nodes_label_the_same_rows(cluster: Cluster, tmp_path: Path) -> None:
    save_scenes(tmp_path / "scenes.jsonl", SCENES)
    done = sweep(tmp_path / "scenes.jsonl", tmp_path / "labels", cluster.address)
    assert done.returncode == 0, done.stderr
    shards = list_shards(tmp_path / "labels")
    assert [info.scenes for info in shards] == [range(i, i + 1) for i in range(4)]
    swept = sort_labels([label for info in shards for label in read_shard(info.path).labels])
    options = LabelOptions(solutions=2, k_max=2)
    here = sort_labels(
        [label for _, labels in label_scenes(SCENES, 0, options, width=4) for label in labels]
    )
    assert len(swept) == len(here) > 10
    for there, label in zip(swept, here, strict=True):
        assert replace(there, violation=0.0) == replace(label, violation=0.0)
        # Shards keep three digits.
        assert there.violation == pytest.approx(label.violation, rel=1e-3, nan_ok=True)


def test_an_address_without_a_cluster_is_named(tmp_path: Path) -> None:
    save_scenes(tmp_path / "scenes.jsonl", SCENES)
    refused = sweep(tmp_path / "scenes.jsonl", tmp_path / "labels", "127.0.0.1:1")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: --ray 127.0.0.1:1: ")
