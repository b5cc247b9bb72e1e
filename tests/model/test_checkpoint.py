"""Checkpoints and exports: what is read is what was written, and what does not fit is refused by name."""

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax
import pytest

from dvr_jax.errors import DvrError
from dvr_jax.model.checkpoint import CheckpointFolder, TrainingState
from dvr_jax.model.export import export_network, load_parameters
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.network import initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.predictor import Predictor

CONFIG = NetworkConfig(image_size=16, channels=(1, 2, 2), dense=4, hidden=5)
PARAMETERS = initial_parameters(CONFIG, 1)
METADATA = NetworkMetadata("dvr", CONFIG, training={"batch": 48, "learning_rate": 5e-4})


def same(one: Any, other: Any) -> bool:
    return jax.tree.structure(one) == jax.tree.structure(other) and all(
        np.array_equal(mine, theirs)
        for mine, theirs in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    )


def test_checkpoint_gives_back_the_state(tmp_path: Path) -> None:
    adam = optax.scale_by_adam()
    _, optimizer = adam.update(PARAMETERS.tree, adam.init(PARAMETERS.tree))
    folder = CheckpointFolder(tmp_path / "run", keep=1)
    assert folder.latest() is None
    for step in (5, 9):
        folder.save(TrainingState(PARAMETERS, optimizer, step, 77), METADATA)
    folder.close()
    again = CheckpointFolder(tmp_path / "run")
    blank = initial_parameters(CONFIG, 2)
    state = again.restore(TrainingState(blank, adam.init(blank.tree), 0, 0), METADATA)
    assert (state.step, state.seed) == (9, 77)
    assert same(state.parameters, PARAMETERS) and same(state.optimizer, optimizer)
    assert again.metadata(9) == METADATA
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["9"]
    parameters, metadata = load_parameters(tmp_path / "run")
    assert same(parameters, PARAMETERS) and metadata == METADATA
    assert same(Predictor.load(tmp_path / "run").parameters, PARAMETERS)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            NetworkMetadata("classifier", CONFIG, training=METADATA.training),
            "trained with kind = dvr, this run has classifier",
        ),
        (NetworkMetadata("dvr", NetworkConfig(hidden=6), training=METADATA.training), "config"),
        (
            NetworkMetadata("dvr", CONFIG, training={**METADATA.training, "batch": 32}),
            "training.batch = 48, this run has 32",
        ),
    ],
)
def test_another_run_is_not_continued(other: NetworkMetadata, message: str) -> None:
    with pytest.raises(DvrError, match=message):
        other.require_same(METADATA, "run, step 3")


def test_export_gives_back_parameters_and_metadata(tmp_path: Path) -> None:
    path = tmp_path / "new" / "network.npz"
    export_network(path, PARAMETERS, METADATA)
    parameters, metadata = load_parameters(path)
    assert same(parameters, PARAMETERS) and metadata == METADATA
    assert [item.name for item in path.parent.iterdir()] == ["network.npz"]


def rewrite(path: Path, change: dict[str, Any]) -> None:
    """An export with parts of the metadata or whole arrays replaced."""
    export_network(path, PARAMETERS, METADATA)
    with np.load(path) as file:
        arrays: dict[str, Any] = dict(file)
    record = json.loads(str(arrays["header"]))
    for name, value in change.items():
        if name in arrays:
            arrays[name] = value
        else:
            record[name] = value
    arrays["header"] = np.array(json.dumps(record))
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"domain": "0123"}, "another symbolic domain \\(signature 0123\\); valid is [0-9a-f]{16}"),
        ({"kind": "oracle"}, "the kind is 'oracle'; valid: dvr, classifier"),
        ({"format": 7}, "the format is 7; valid is 2"),
        ({"config": {"hidden": 5}}, "the metadata are incomplete"),
        ({"config": {"hidden": 5, "channels": 3}}, "the metadata are incomplete"),
        (
            {"config": {"hidden": float("nan"), "channels": [5, 10, 10]}},
            "this is no exported network \\(NaN is no JSON number\\)",
        ),
        (
            {"output/kernel": np.full((5, 1), np.nan)},
            "output/kernel has values that are not finite numbers",
        ),
        (
            {"output/kernel": np.full((5, 1), "x")},
            "output/kernel has values that are not finite numbers",
        ),
        (
            {"output/kernel": np.zeros((6, 1))},
            "output/kernel has shape \\(6, 1\\); its sizes ask for \\(5, 1\\)",
        ),
    ],
)
def test_exports_that_do_not_fit_are_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    rewrite(tmp_path / "network.npz", change)
    with pytest.raises(DvrError, match=message):
        load_parameters(tmp_path / "network.npz")


def test_what_is_no_network_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "network.npz"
    for content in (b"", b"nonsense", b"PK\x03\x04cut short"):
        path.write_bytes(content)
        with pytest.raises(DvrError, match="no exported network"):
            load_parameters(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(DvrError, match="no exported network"):
        load_parameters(path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DvrError, match="there is no checkpoint"):
        load_parameters(tmp_path / "empty")


def state_of(step: int) -> TrainingState:
    adam = optax.scale_by_adam()
    return TrainingState(
        initial_parameters(CONFIG, step), adam.init(PARAMETERS.tree), step, seed=77
    )


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder with checkpoints of the steps 5 and 9."""
    folder = CheckpointFolder(tmp_path / "run")
    for step in (5, 9):
        folder.save(state_of(step), METADATA)
    folder.close()
    return tmp_path / "run"


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_any_file_of_a_checkpoint_may_be_damaged(run: Path) -> None:
    """Cut short, changed or missing: the checkpoint before it counts."""
    for path in files_of(run / "9"):
        whole = path.read_bytes()
        for damaged in (whole[:-2], bytes([whole[0] ^ 1]) + whole[1:], b"", None):
            path.unlink()
            if damaged is not None:
                path.write_bytes(damaged)
            parameters, metadata = load_parameters(run)
            assert same(parameters, initial_parameters(CONFIG, 5)) and metadata == METADATA
        path.write_bytes(whole)
    assert same(load_parameters(run)[0], initial_parameters(CONFIG, 9))


def test_a_damaged_checkpoint_is_set_aside_and_written_again(run: Path) -> None:
    path = files_of(run / "9" / "parameters")[0]
    path.write_bytes(path.read_bytes()[:-1])
    folder = CheckpointFolder(run)
    (sentence,) = folder.set_damaged_aside()
    assert sentence.startswith(f"{run}, step 9: the file parameters/") and "9.damaged" in sentence
    assert folder.restore(state_of(0), METADATA).step == 5
    assert folder.set_damaged_aside() == []
    folder.save(state_of(9), METADATA)
    folder.close()
    assert {"5", "9", "9.damaged"} == {item.name for item in run.iterdir()}
    assert same(load_parameters(run)[0], initial_parameters(CONFIG, 9))


def test_where_all_checkpoints_are_damaged_nothing_is_begun_anew(run: Path) -> None:
    for step in ("5", "9"):
        files_of(run / step / "rest")[0].unlink()
    with pytest.raises(
        DvrError, match=r"step 9: the file rest/.* and no other checkpoint is intact"
    ):
        CheckpointFolder(run).latest()


def test_checkpoints_of_earlier_versions_have_no_checksums(run: Path) -> None:
    for step in ("5", "9"):
        (run / step / "checksums.json").unlink()
        metadata = run / step / "header" / "metadata"
        record = json.loads(metadata.read_text())
        del record["sealed"]
        metadata.write_text(json.dumps(record))
    assert CheckpointFolder(run).restore(state_of(0), METADATA).step == 9


def test_any_byte_of_an_export_may_be_changed(tmp_path: Path) -> None:
    """What is accepted has the same parameters and metadata."""
    path = tmp_path / "network.npz"
    export_network(path, PARAMETERS, METADATA)
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 37):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
        try:
            parameters, metadata = load_parameters(path)
        except DvrError as error:
            refused += 1
            assert str(path) in str(error)
        else:
            assert same(parameters, PARAMETERS) and metadata == METADATA
    assert refused > 50
