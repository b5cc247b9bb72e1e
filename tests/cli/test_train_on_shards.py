"""From shards to a network: the training command takes what the data set writes."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic import OPTIONS, synthetic

from dvr_jax.cli import train
from dvr_jax.dataset.examples import load_examples
from dvr_jax.dataset.shards import write_shard
from dvr_jax.model.predictor import Predictor


def test_shards_make_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "shards"
    folder.mkdir()
    for first in (0, 5):
        write_shard(folder / f"{first:06}.parquet", *synthetic(first, first + 5), OPTIONS)
    out = tmp_path / "out"
    options = "--image-size 8 --rays 1 --batch 8 --least-feasible 2 --steps 4 --log-every 2 --checkpoint-every 4"
    monkeypatch.setattr(
        sys, "argv", ["train", "--data", str(folder), "--out", str(out), *options.split()]
    )
    assert train.main() == 0
    manifest = json.loads((out / "manifest.json").read_text())
    examples = load_examples(folder)
    assert 0 < manifest["counts"]["scenes"] <= len(examples.scenes)
    assert manifest["counts"]["sequences"] <= len(examples.length)
    encoding = Predictor.load(out / "network.npz").encode_scene(examples.scenes[0])
    assert np.isfinite(encoding.input_gates).all()
