"""Sweeps: the same rows whatever shares a batch, and after a kill; what does not fit is refused."""

import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from dvr_jax.dataset import footer
from dvr_jax.dataset.labelling import Labelling, LabelOptions
from dvr_jax.dataset.labels import same_label, sort_labels
from dvr_jax.dataset.shards import list_shards, read_shard, same_rows, write_shard
from dvr_jax.planning.label_workers import label_scenes
from dvr_jax.scene.files import save_scenes
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree

LEAVES = [Node((), 0, None, reaches_goal=True) for _ in range(8)]
OPTIONS = LabelOptions(solutions=2, k_max=3)
SCENES = tuple(sample_scenes(6, 1, 4))
KILLED_SCENES = 120


def sweep(scenes: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    arguments = [
        "--scenes",
        str(scenes),
        "--out",
        str(out),
        "--k-max",
        "3",
        "--solutions",
        "2",
        "--shard",
        "1",
    ]
    command = [sys.executable, "-m", "dvr_jax.sweep", *arguments, "--workers", "1", *more]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenes") / "scenes.jsonl"
    save_scenes(path, SCENES)
    return path


def test_rows_do_not_depend_on_what_shares_a_batch() -> None:
    alone = [label for _, labels in label_scenes(SCENES, 0, OPTIONS, width=1) for label in labels]
    together = [
        label for _, labels in label_scenes(SCENES, 0, OPTIONS, width=6) for label in labels
    ]
    assert len(alone) == len(together) > 20
    assert any(label.feasible for label in alone) and any(label.refuted_prefix for label in alone)
    assert all(map(same_label, sort_labels(alone), sort_labels(together)))


def test_a_killed_sweep_ends_with_the_same_rows(scenes: Path, tmp_path: Path) -> None:
    assert sweep(scenes, tmp_path / "whole").wait() == 0
    process = sweep(scenes, tmp_path / "cut")
    while not list((tmp_path / "cut").glob("*.parquet")):
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = list_shards(tmp_path / "cut")
    assert 1 <= len(done) < len(SCENES)
    written = {info.path: info.path.stat().st_mtime_ns for info in done}
    assert sweep(scenes, tmp_path / "cut").wait() == 0
    cut, whole = list_shards(tmp_path / "cut"), list_shards(tmp_path / "whole")
    assert (
        [info.scenes for info in cut]
        == [info.scenes for info in whole]
        == [range(i, i + 1) for i in range(len(SCENES))]
    )
    assert all(
        same_rows(read_shard(a.path), read_shard(b.path)) for a, b in zip(cut, whole, strict=True)
    )
    assert all(path.stat().st_mtime_ns == time for path, time in written.items())
    assert (tmp_path / "cut" / "_manifest.json").exists()

    refused = sweep(scenes, tmp_path / "cut", "--seed", "1")
    assert refused.wait() == 2
    assert "comes of another sweep" in refused.stderr.read()  # type: ignore[union-attr]
    # The same seed on another processor.
    x, y = SCENES[0].objects[0].position
    moved = replace(SCENES[0].objects[0], position=(math.nextafter(x, 1), y))
    save_scenes(tmp_path / "rounded.jsonl", (replace(SCENES[0], objects=(moved,)), *SCENES[1:]))
    assert sweep(tmp_path / "rounded.jsonl", tmp_path / "cut").wait() == 0
    save_scenes(tmp_path / "others.jsonl", SCENES[::-1])
    refused = sweep(tmp_path / "others.jsonl", tmp_path / "cut")
    assert refused.wait() == 2
    assert "holds other scenes" in refused.stderr.read()  # type: ignore[union-attr]


@pytest.mark.slow
def test_ten_kills_at_random_moments_lose_nothing(tmp_path: Path) -> None:
    """Two workers, two boxes, the default options; some kills come before the first shard, some within one."""
    scenes = tuple(sample_scenes(KILLED_SCENES, 2, 5))
    save_scenes(tmp_path / "scenes.jsonl", scenes)
    command = [
        sys.executable,
        "-m",
        "dvr_jax.sweep",
        "--scenes",
        str(tmp_path / "scenes.jsonl"),
        "--shard",
        "2",
    ]
    subprocess.run([*command, "--workers", "2", "--out", str(tmp_path / "whole")], check=True)
    killed = [*command, "--workers", "2", "--out", str(tmp_path / "killed")]
    done = []
    for moment in np.random.default_rng(0).uniform(2, 25, 10):
        process = subprocess.Popen(killed, start_new_session=True)
        time.sleep(moment)
        assert process.poll() is None, "the sweep was over before it was killed ten times"
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        done.append(len(list_shards(tmp_path / "killed")))
    assert done == sorted(done) and 0 < done[-1] < KILLED_SCENES // 2
    subprocess.run(killed, check=True)
    cut, whole = list_shards(tmp_path / "killed"), list_shards(tmp_path / "whole")
    assert [info.scenes for info in cut] == [info.scenes for info in whole]
    assert all(
        same_rows(read_shard(a.path), read_shard(b.path)) for a, b in zip(cut, whole, strict=True)
    )
    assert sorted(path.name for path in (tmp_path / "killed").iterdir()) == sorted(
        path.name for path in (tmp_path / "whole").iterdir()
    )


def test_shards_of_another_version_are_refused(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Labels depend on the solver."""
    others = footer.versions() | {"dvr_jax": "0.0.1"}
    monkeypatch.setattr(footer, "versions", lambda: others)
    write_shard(tmp_path / "labels-000000.parquet", {0: SCENES[0]}, [], asdict(OPTIONS))
    process = sweep(scenes, tmp_path)
    assert process.wait() == 2
    assert "was made by dvr_jax 0.0.1" in process.stderr.read()  # type: ignore[union-attr]


def test_shards_of_more_scenes_than_the_file_has_are_refused(scenes: Path, tmp_path: Path) -> None:
    number = len(scenes.read_text().splitlines())
    write_shard(tmp_path / "a.parquet", {number: SCENES[0]}, [], asdict(OPTIONS))
    process = sweep(scenes, tmp_path)
    assert process.wait() == 2
    assert f"goes beyond the {number} scenes of" in process.stderr.read()  # type: ignore[union-attr]


def test_sequences_of_one_length_come_in_an_order_of_the_scene_and_the_seed() -> None:
    def order(scene: Scene, seed: int) -> list[Node]:
        options = replace(OPTIONS, seed=seed)
        labelling = Labelling(SequenceTree(scene, 3), scene, options, lambda *_: True)
        return labelling.arrange(LEAVES)

    leaves = list(LEAVES)
    orders = [
        order(scene, seed)
        for scene, seed in ((SCENES[0], 0), (SCENES[0], 0), (SCENES[0], 1), (SCENES[1], 0))
    ]
    assert orders[0] == orders[1] and leaves == LEAVES
    assert all(first != second for first, second in combinations([leaves, *orders[1:]], 2))
    assert all(sorted(map(id, found)) == sorted(map(id, leaves)) for found in orders)


def test_a_missing_scene_file_is_named(tmp_path: Path) -> None:
    process = sweep(tmp_path / "none.jsonl", tmp_path / "out")
    assert process.wait() == 2
    assert "none.jsonl" in process.stderr.read()  # type: ignore[union-attr]
