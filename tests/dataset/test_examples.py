"""Examples: what is labeled is there as it is, what is drawn lies under a refuted prefix and reaches the goal."""

import hashlib
import json
import shutil
from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.counts import count_infeasible_sequences
from dvr_jax.dataset.examples import Examples, count_targets, load_examples
from dvr_jax.dataset.folder_manifest import write_manifest
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.sequence_index import sequence_index_of
from dvr_jax.dataset.shards import list_shards, read_shard
from dvr_jax.dataset.shards import write_shard as write
from dvr_jax.dataset.targets import targets
from dvr_jax.errors import DvrError
from dvr_jax.logic import Grounding, enumerate_sequences, ground_actions
from dvr_jax.scene.types import Scene


def ground(scene: Scene) -> Grounding:
    names = [item.name for item in scene.objects]
    return ground_actions(names, scene.goal.object, scene.workcell.arm_names)


def sequences_of(examples: Examples, scene: int) -> dict[tuple[int, ...], bool]:
    """Sequences of one scene with their verdicts; none may occur twice."""
    rows = np.flatnonzero(examples.scene == scene)
    found = [tuple(examples.actions[row, : examples.length[row]].tolist()) for row in rows]
    assert len(set(found)) == len(found)
    return dict(zip(found, examples.feasible[rows].tolist(), strict=True))


def names(grounding: Grounding, sequence: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(str(grounding.actions[index]) for index in sequence)


@pytest.fixture(scope="module")
def examples(folder: Path) -> Examples:
    return load_examples(folder, completions=3, solved_only=False)


@pytest.fixture(scope="module")
def labels(folder: Path) -> dict[Scene, list[Label]]:
    shards = [read_shard(info.path) for info in list_shards(folder)]
    return {
        scene: [label for label in shard.labels if label.scene == index]
        for shard in shards
        for index, scene in zip(shard.info.scenes, shard.scenes, strict=True)
    }


def test_shapes(examples: Examples) -> None:
    n = len(examples.scene)
    assert examples.actions.shape == examples.targets.shape == (n, 6)
    assert (examples.actions.dtype, examples.targets.dtype) == (np.int32, np.float32)
    padded = np.arange(6) >= examples.length[:, None]
    assert np.array_equal(examples.actions == -1, padded)
    assert not examples.targets[padded].any()
    assert set(examples.scene.tolist()) == set(range(len(examples.scenes)))


def test_every_label_is_an_example(examples: Examples, labels: dict[Scene, list[Label]]) -> None:
    for number, scene in enumerate(examples.scenes):
        grounding = ground(scene)
        found = {
            names(grounding, actions): verdict
            for actions, verdict in sequences_of(examples, number).items()
        }
        for label in labels[scene]:
            if not label.refuted_prefix:
                assert found.pop(label.actions) == label.feasible
        refuted = {label.actions for label in labels[scene] if label.refuted_prefix}
        for words, verdict in found.items():  # the drawn ones
            assert not verdict
            assert any(words[:length] in refuted for length in range(len(words) + 1))


def test_all_reach_the_goal(examples: Examples) -> None:
    for number, scene in enumerate(examples.scenes):
        grounding = ground(scene)
        for sequence in sequences_of(examples, number):
            grounding.check_sequence([grounding.actions[index] for index in sequence])


def test_each_prefix_contributes(examples: Examples, labels: dict[Scene, list[Label]]) -> None:
    """Three continuations of each prefix, or all that there are; here no prefix lies under another."""
    for number, scene in enumerate(examples.scenes):
        grounding, index = ground(scene), sequence_index_of(scene)
        found = [names(grounding, sequence) for sequence in sequences_of(examples, number)]
        for label in labels[scene]:
            if label.refuted_prefix:
                under = [words for words in found if words[: len(label.actions)] == label.actions]
                state = index.state_after(index.indices(label.actions))
                assert len(under) == min(3, index.count_up_to(state, 6 - len(label.actions))) > 0


def test_targets_are_those_of_the_scene(examples: Examples) -> None:
    for number in range(len(examples.scenes)):
        verdicts = sequences_of(examples, number)
        expected = np.concatenate(targets(list(verdicts), list(verdicts.values())))
        rows = examples.scene == number
        filled = np.arange(6) < examples.length[rows][:, None]
        assert np.array_equal(examples.targets[rows][filled], expected)


def test_same_seed_same_examples(folder: Path, examples: Examples) -> None:
    again, other = (load_examples(folder, 3, seed=seed, solved_only=False) for seed in (0, 1))
    assert examples.scenes == again.scenes == other.scenes
    assert all(np.array_equal(a, b) for a, b in zip(examples[1:], again[1:], strict=True))
    assert not np.array_equal(examples.actions, other.actions)


def test_a_scene_does_not_depend_on_the_others(folder: Path, examples: Examples) -> None:
    alone = load_examples(folder / "000005.parquet", solved_only=False)
    first = examples.scenes.index(alone.scenes[0])
    assert np.array_equal(alone.actions, examples.actions[examples.scene >= first])


def test_only_solved_scenes_by_default(folder: Path, examples: Examples) -> None:
    solved = load_examples(folder)
    assert 0 < len(solved.scenes) < len(examples.scenes)
    assert all(any(sequences_of(solved, number).values()) for number in range(len(solved.scenes)))
    kept = np.isin(examples.scene, np.unique(examples.scene[examples.feasible]))
    assert np.array_equal(solved.actions, examples.actions[kept])


def test_k_max_cuts_before_targets(folder: Path) -> None:
    short = load_examples(folder, k_max=3, solved_only=False)
    assert short.actions.shape[1] == 3 and short.length.max() == 3
    for number in range(len(short.scenes)):
        verdicts = sequences_of(short, number)
        ones = int(np.concatenate(targets(list(verdicts), list(verdicts.values()))).sum())
        assert short.targets[short.scene == number].sum() == ones


def test_counts(examples: Examples) -> None:
    counts = count_targets(examples)
    assert counts.feasible + counts.infeasible == len(examples.scene)
    assert counts.ones + counts.zeros == examples.length.sum()
    assert counts.ones == examples.targets.sum() > 0
    assert counts.feasible == examples.feasible.sum() > 0
    inside = np.arange(examples.actions.shape[1]) < examples.length[:, None]
    zeros, known = inside & (examples.targets == 0), examples.weight == 1
    assert not examples.weight[~known].any() and not known[~inside].any()
    assert counts.zeros == zeros.sum() and counts.known_zeros == (zeros & known).sum() > 0
    assert (
        counts.first_zeros == zeros[:, 0].sum()
        and counts.known_first_zeros == (zeros & known)[:, 0].sum()
    )


def test_all_continuations_and_none_labeled_otherwise(tmp_path: Path) -> None:
    """Nested prefixes and a labeled continuation: with no bound on their number, each continuation is there once."""
    scenes, _ = synthetic(0, 1, rows=0)
    grounding = ground(scenes[0])
    every = [s for length in range(1, 5) for s in enumerate_sequences(grounding, length)]
    one = next(s for s in every if len(s) == 4)
    other = next(s for s in every if s[0] != one[0])
    labels = [
        Label(0, names(grounding, one[:1]), False, True, "pose", nan),
        Label(0, names(grounding, one[:2]), False, True, "sequence", 9.0),
        Label(0, names(grounding, one), False, False, "path", 3.0),
        Label(0, names(grounding, other), True, False, "", 0.1),
    ]
    write(tmp_path / "a.parquet", scenes, labels, OPTIONS)
    expected = {s: False for s in every if s[0] == one[0]} | {other: True}
    assert sequences_of(load_examples(tmp_path, completions=10**6, k_max=4), 0) == expected
    assert count_infeasible_sequences(list_shards(tmp_path), k_max=4) == len(expected) - 1
    assert sequences_of(load_examples(tmp_path, completions=0, k_max=4), 0) == {
        one: False,
        other: True,
    }


def test_a_refuted_root_stands_for_all(tmp_path: Path) -> None:
    scenes, _ = synthetic(0, 1, rows=0)
    write(tmp_path / "a.parquet", scenes, [Label(0, (), False, True, "symbolic", nan)], OPTIONS)
    assert count_infeasible_sequences(list_shards(tmp_path), k_max=4) == 8 + 96 + 704
    assert len(load_examples(tmp_path, 5, solved_only=False).scene) == 5
    assert load_examples(tmp_path).actions.shape == (0, 6)


def test_many_objects_and_names_share_nothing(tmp_path: Path) -> None:
    scenes, labels = synthetic(0, 2, rows=30, objects=5)
    renamed = replace(
        scenes[1],
        objects=tuple(
            replace(item, name=f"{item.name}; {i}") for i, item in enumerate(scenes[1].objects)
        ),
        goal=replace(scenes[1].goal, object=f"{scenes[1].goal.object}; {scenes[1].goal_index}"),
    )
    of_first = [label for label in labels if label.scene == 0]
    of_second = [
        replace(
            label,
            actions=names(
                ground(renamed), tuple(map(list(map(str, ground(scenes[1]).actions)).index, a))
            ),
        )
        for label in labels
        if label.scene == 1
        for a in [label.actions]
    ]
    write(tmp_path / "a.parquet", {0: scenes[0], 1: renamed}, of_first + of_second, OPTIONS)
    renamed_examples = load_examples(tmp_path, solved_only=False)
    write(tmp_path / "a.parquet", scenes, labels, OPTIONS)
    assert renamed_examples.scenes[1] == renamed
    assert {a: b for a, b in sequences_of(renamed_examples, 0).items()} == sequences_of(
        load_examples(tmp_path, solved_only=False), 0
    )


def test_bad_requests(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="there is no shard in"):
        load_examples(tmp_path)
    with pytest.raises(DvrError, match="there is no file or folder"):
        load_examples([folder, tmp_path / "missing"])
    with pytest.raises(DvrError, match="valid are at least 0 and at least 1"):
        load_examples(folder, completions=-1)
    with pytest.raises(DvrError, match="overlap"):
        load_examples([folder, folder / "000000.parquet"])


def test_sweeps_of_different_scenes_are_learned_from_together(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    once, twice = load_examples(folder), load_examples([folder, other])
    assert len(twice.scenes) == 2 * len(once.scenes) and len(twice.actions) == 2 * len(once.actions)


def test_manifest(folder: Path, labels: dict[Scene, list[Label]]) -> None:
    path = write_manifest(folder, command=["python", "-m", "dvr_jax.sweep", "--out", "a folder"])
    manifest = json.loads(path.read_text())
    rows = [label for of_scene in labels.values() for label in of_scene]
    feasible = [{len(label.actions) for label in own if label.feasible} for own in labels.values()]
    shortest = [min(lengths) for lengths in feasible if lengths]
    assert manifest["command"] == "python -m dvr_jax.sweep --out 'a folder'"
    assert manifest["seeds"] == {"seed": 1}
    assert manifest["counts"] == {
        "scenes": 10,
        "solved": len(shortest),
        "feasible": sum(label.feasible for label in rows),
        "infeasible": sum(not label.feasible and not label.refuted_prefix for label in rows),
        "refuted_prefixes": sum(label.refuted_prefix for label in rows),
        "shortest": {str(length): shortest.count(length) for length in sorted(set(shortest))},
    }
    for entry in manifest["shards"]:
        assert entry["sha256"] == hashlib.sha256((folder / entry["file"]).read_bytes()).hexdigest()
