"""Training examples: the labeled sequences of shards, and some continuations of each refuted prefix, with targets.

A refuted prefix stands for up to thousands of infeasible sequences, which differ only in actions after the prefix. A
few of these are drawn, without replacement and uniformly among all that have at most k_max actions. There are about
eight times as many continuations of each further length, so most of those drawn are as long as they may be.
"""

import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32

from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.known_prefixes import KnownPrefixes
from dvr_jax.dataset.labeled_scenes import LabeledScene, labeled_scenes
from dvr_jax.dataset.sequence_index import ActionNumbers
from dvr_jax.dataset.shards import find_shards, read_columns
from dvr_jax.dataset.targets import targets
from dvr_jax.errors import DvrError
from dvr_jax.operators import OPERATORS, is_duplicate, refute
from dvr_jax.scene.types import Scene

PADDING = -1
"""In `Examples.actions` after the end of a sequence."""


class Examples(NamedTuple):
    """Sequences of at most k_max actions; all examples of one scene lie side by side."""

    scenes: list[Scene]
    """Distinct scenes that have at least one example."""

    scene: Int32[np.ndarray, " examples"]
    """Index into `scenes`."""

    actions: Int32[np.ndarray, "examples k_max"]
    """Index into the actions of the grounding of the scene, or PADDING."""

    targets: Float32[np.ndarray, "examples k_max"]
    """f_j of the paper: 1 where the first j actions begin a feasible sequence, else 0; 0 where padded."""

    weight: Float32[np.ndarray, "examples k_max"]
    """1 where a target is known, by `dvr_jax.dataset.known_prefixes`, else 0; 0 where padded."""

    refuted_after: Int32[np.ndarray, " examples"]
    """Number of actions after which a label refutes the sequence, or 0 if the sequence is feasible."""

    length: Int32[np.ndarray, " examples"]
    """Number of actions."""

    feasible: Bool[np.ndarray, " examples"]
    """Verdict on the whole sequence."""


class TargetCounts(NamedTuple):
    """Counts of the sequences and targets that a network would be trained on; padding does not count."""

    scenes: int
    """Distinct scenes."""

    feasible: int
    """Sequences that are feasible."""

    infeasible: int
    """Sequences that are infeasible, drawn continuations included."""

    ones: int
    """Targets that are 1."""

    zeros: int
    """Targets that are 0."""

    known_zeros: int
    """Targets that are 0 and follow from the labels."""

    first_zeros: int
    """Targets of first actions that are 0."""

    known_first_zeros: int
    """Targets of first actions that are 0 and follow from the labels."""


@dataclass(frozen=True, slots=True)
class _ExampleOptions:
    """The options of `load_examples`."""

    completions: int
    k_max: int
    seed: int
    solved_only: bool


@dataclass(slots=True)
class _ExampleLists:
    """Examples as they are collected, one entry for each sequence."""

    scenes: list[Scene] = field(default_factory=list)
    scene: list[int] = field(default_factory=list)
    sequences: list[ActionNumbers] = field(default_factory=list)
    feasible: list[bool] = field(default_factory=list)
    targets: list[Float32[np.ndarray, " actions"]] = field(default_factory=list)
    is_known: list[list[bool]] = field(default_factory=list)
    refuted_after: list[int] = field(default_factory=list)


def load_examples(
    paths: str | Path | Iterable[str | Path],
    completions: int = 3,
    k_max: int = 6,
    seed: int = 0,
    solved_only: bool = True,
) -> Examples:
    """Load the examples of shards and of folders of shards.

    Each refuted prefix contributes `completions` of its continuations that reach the goal, or as many as there are. No
    such continuation has a label itself or is drawn for another prefix. The draw in a scene depends on the seed, on the
    index of the scene and on its labels alone.

    Args:
        paths: shards and folders of shards.
        completions: number of continuations to draw for each refuted prefix.
        k_max: largest number of actions; longer sequences are left out before targets are computed.
        seed: seed of the draw.
        solved_only: whether scenes without a feasible sequence are left out, as in the paper.

    Returns:
        The examples in the order of the shards.

    Raises:
        DvrError: there is no shard, a shard is broken, or an option is not valid.
    """
    if completions < 0 or k_max < 1:
        raise DvrError(
            f"completions is {completions} and k_max {k_max}; valid are at least 0 and at least 1."
        )
    options = _ExampleOptions(completions, k_max, seed, solved_only)

    # Shard by shard: as lists, all sequences of a large data set take ten times the memory of their arrays.
    parts = [_examples_of_shard(info, options) for info in find_shards(paths)]
    scenes: list[Scene] = []
    scene: list[np.ndarray] = []
    for part in parts:
        scene.append(part.scene + np.int32(len(scenes)))
        scenes += part.scenes

    return Examples(
        scenes=scenes,
        scene=np.concatenate(scene, dtype=np.int32),
        actions=np.concatenate([part.actions for part in parts]),
        targets=np.concatenate([part.targets for part in parts]),
        weight=np.concatenate([part.weight for part in parts]),
        refuted_after=np.concatenate([part.refuted_after for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        feasible=np.concatenate([part.feasible for part in parts]),
    )


def count_targets(examples: Examples) -> TargetCounts:
    """Count sequences by verdict, and targets by value."""
    feasible = int(examples.feasible.sum())
    ones = int(examples.targets.sum(dtype=np.float64))
    is_known_zero = (examples.weight > 0) & (examples.targets == 0)
    return TargetCounts(
        scenes=len(examples.scenes),
        feasible=feasible,
        infeasible=len(examples.feasible) - feasible,
        ones=ones,
        zeros=int(examples.length.sum()) - ones,
        known_zeros=int(is_known_zero.sum()),
        first_zeros=int((examples.targets[:, :1] == 0).sum()),
        known_first_zeros=int(is_known_zero[:, :1].sum()),
    )


def _examples_of_shard(info: ShardInfo, options: _ExampleOptions) -> Examples:
    """Collect the examples of one shard."""
    lists = _ExampleLists()
    for labeled in labeled_scenes(info, read_columns(info), options.solved_only):
        _collect(lists, labeled, options)
    return _as_arrays(lists, options.k_max)


def _collect(lists: _ExampleLists, labeled: LabeledScene, options: _ExampleOptions) -> None:
    """Append the examples of one scene."""
    feasible_by_sequence = {
        sequence: feasible
        for sequence, feasible in labeled.judged.items()
        if len(sequence) <= options.k_max
    }
    known = _known_prefixes(labeled, feasible_by_sequence)

    # What is drawn for one prefix is not drawn again for another.
    generator = random.Random(f"{options.seed} {labeled.number}")
    for prefix in labeled.refuted_prefixes:
        for sequence in _draw(labeled, prefix, feasible_by_sequence, options, generator):
            feasible_by_sequence[sequence] = False

    sequences = list(feasible_by_sequence)
    feasible = list(feasible_by_sequence.values())
    if not sequences or (options.solved_only and not any(feasible)):
        return
    lists.scene += [len(lists.scenes)] * len(sequences)
    lists.scenes.append(labeled.scene)
    lists.sequences += sequences
    lists.feasible += feasible
    lists.targets += targets(sequences, feasible)
    lists.is_known += map(known.known_steps, sequences)
    lists.refuted_after += map(known.refuted_after, sequences)


def _known_prefixes(
    labeled: LabeledScene,
    feasible_by_sequence: dict[ActionNumbers, bool],
) -> KnownPrefixes:
    """Gather what the labels and the constants of a scene say of its prefixes."""
    feasible: list[ActionNumbers] = []
    infeasible: list[ActionNumbers] = []
    for sequence, verdict in feasible_by_sequence.items():
        same_verdict = feasible if verdict else infeasible
        same_verdict.append(sequence)

    impossible: list[int] = []
    duplicates: list[int] = []
    for number, action in enumerate(labeled.index.grounding.actions):
        if refute(labeled.scene, action, OPERATORS) is not None:
            impossible.append(number)
        if is_duplicate(labeled.scene, action, OPERATORS):
            duplicates.append(number)

    return KnownPrefixes(
        labeled.index,
        feasible=feasible,
        infeasible=infeasible,
        refuted=labeled.refuted_prefixes,
        impossible=impossible,
        duplicates=duplicates,
    )


def _draw(
    labeled: LabeledScene,
    prefix: ActionNumbers,
    taken: dict[ActionNumbers, bool],
    options: _ExampleOptions,
    generator: random.Random,
) -> list[ActionNumbers]:
    """Draw continuations of a refuted prefix that are not taken yet."""
    drawn: list[ActionNumbers] = []
    if options.completions == 0:
        return drawn

    # The draw ends with the last continuation wanted, so that the generator serves the next prefix from there on.
    for sequence in labeled.index.draw(prefix, options.k_max, generator):
        if sequence in taken:
            continue
        drawn.append(sequence)
        if len(drawn) == options.completions:
            break
    return drawn


def _as_arrays(lists: _ExampleLists, k_max: int) -> Examples:
    """Pad sequences, targets and weights to k_max actions."""
    length = np.array([len(sequence) for sequence in lists.sequences], dtype=np.int32)
    is_action = np.arange(k_max) < length[:, None]
    return Examples(
        scenes=lists.scenes,
        scene=np.array(lists.scene, dtype=np.int32),
        actions=_padded(is_action, lists.sequences, PADDING, np.int32),
        targets=_padded(is_action, lists.targets, 0, np.float32),
        weight=_padded(is_action, lists.is_known, 0, np.float32),
        refuted_after=np.array(lists.refuted_after, dtype=np.int32),
        length=length,
        feasible=np.array(lists.feasible, dtype=np.bool_),
    )


def _padded(
    is_action: Bool[np.ndarray, "examples k_max"],
    rows: "Sequence[Sequence[float] | np.ndarray]",
    padding: int,
    dtype: type[np.int32] | type[np.float32],
) -> np.ndarray:
    """Write rows of different lengths into one array."""
    table = np.full(is_action.shape, padding, dtype=dtype)
    if len(rows):
        # A mask is filled row by row, in the order of the sequences.
        table[is_action] = np.concatenate([np.asarray(row, dtype=dtype) for row in rows])
    return table
