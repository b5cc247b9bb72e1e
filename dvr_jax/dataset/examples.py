"""Training examples: the labelled sequences of shards, and some continuations of each refuted prefix, with targets.

A refuted prefix stands for up to thousands of infeasible sequences that differ only after the verdict has been spoken.
Of these, a few are drawn, without replacement and uniformly among all that have at most k_max actions. There are about
eight times as many of each further length, so most of them are as long as they may be.
"""

import random
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvr_jax.dataset.footer import ShardInfo, require_agreement
from dvr_jax.dataset.shards import SUFFIX, Columns, list_shards, read_columns, read_info
from dvr_jax.dataset.symbols import SequenceIndex, sequence_index
from dvr_jax.dataset.targets import Verdicts, targets
from dvr_jax.errors import DvrError
from dvr_jax.nlp.transcription import is_duplicate, refute
from dvr_jax.scene.files import scene_from_json
from dvr_jax.scene.types import Scene

PADDING = -1
"""In `Examples.actions` after a sequence's end."""


class Examples(NamedTuple):
    """n sequences of at most K = k_max actions; all examples of one scene lie side by side."""

    scenes: list[Scene]
    """Distinct scenes that have at least one example (S)."""
    scene: NDArray[np.int32]
    """Index into `scenes` (n,)."""
    actions: NDArray[np.int32]
    """Index into the actions of the scene's grounding, or PADDING (n, K)."""
    targets: NDArray[np.float32]
    """f_j of the paper: 1 where the first j actions begin a feasible sequence, else 0, also where padded (n, K)."""
    weight: NDArray[np.float32]
    """How much a target counts: 1 where it is known, by `dvr_jax.dataset.targets.Verdicts`, else 0 (n, K)."""
    refuted_after: NDArray[np.int32]
    """Number of actions after which a label refutes the sequence, 0 if it is feasible (n,)."""
    length: NDArray[np.int32]
    """Number of actions (n,)."""
    feasible: NDArray[np.bool_]
    """Verdict on the whole sequence (n,)."""


class TargetCounts(NamedTuple):
    """What a network would be trained on."""

    scenes: int
    feasible: int
    """Sequences."""
    infeasible: int
    """Sequences, drawn continuations included."""
    ones: int
    """Targets, padding not counted."""
    zeros: int
    """Targets, padding not counted."""
    known_zeros: int
    """Of these, those that follow from the labels."""
    first_zeros: int
    """Zeros of first actions."""
    known_first_zeros: int
    """Of these, those that follow from the labels."""


def load_examples(
    paths: str | Path | Iterable[str | Path],
    completions: int = 3,
    k_max: int = 6,
    seed: int = 0,
    solved_only: bool = True,
) -> Examples:
    """The examples of shards and of folders of shards.

    Each refuted prefix contributes `completions` of its goal-reaching continuations, or as many as there are, none of
    them labelled itself nor drawn for another prefix. What is drawn in a scene depends on the seed, on the scene's
    index and on its labels alone. Sequences longer than k_max are left out before targets are computed. As in the
    paper, scenes without a feasible sequence are left out unless `solved_only` is false.
    """
    if completions < 0 or k_max < 1:
        raise DvrError(f"completions is {completions} and k_max {k_max}; valid are at least 0 and at least 1.")
    # Shard by shard: as lists, all sequences of a large data set take ten times the memory of their arrays.
    parts = [_examples_of(info, completions, k_max, seed, solved_only) for info in find_shards(paths)]
    first = np.cumsum([0, *(len(part.scenes) for part in parts)])
    return Examples(
        [scene for part in parts for scene in part.scenes],
        np.concatenate([part.scene + number for part, number in zip(parts, first, strict=False)], dtype=np.int32),
        *(np.concatenate(values) for values in list(zip(*parts, strict=True))[2:]),
    )


def _examples_of(info: ShardInfo, completions: int, k_max: int, seed: int, solved_only: bool) -> Examples:
    """The examples of one shard."""
    scenes: list[Scene] = []
    scene: list[int] = []
    sequences: list[tuple[int, ...]] = []
    feasible: list[bool] = []
    values: list[NDArray[np.float32]] = []
    knowledge: list[list[bool]] = []
    refuted: list[int] = []
    columns = read_columns(info)
    for row, symbols, candidate in scenes_of(info, columns):
        if solved_only and not columns.feasible[slice(*columns.label_ends[row : row + 2])].any():
            continue  # before anything is drawn for it
        generator = random.Random(f"{seed} {info.scenes[row]}")
        own, verdicts, known = _expand(columns, row, candidate, symbols, completions, k_max, generator, str(info))
        if not own or (solved_only and not any(verdicts)):
            continue
        scene += [len(scenes)] * len(own)
        scenes.append(candidate)
        sequences += own
        feasible += verdicts
        values += targets(own, verdicts)
        knowledge += map(known.known_steps, own)
        refuted += map(known.refuted_after, own)
    length = np.array([len(sequence) for sequence in sequences], dtype=np.int32)
    filled = np.arange(k_max) < length[:, None]
    actions = np.full(filled.shape, PADDING, dtype=np.int32)
    padded, weight = np.zeros((2, *filled.shape), dtype=np.float32)
    if sequences:  # a mask is filled row by row, in the order of the sequences
        actions[filled] = [index for sequence in sequences for index in sequence]
        padded[filled], weight[filled] = np.concatenate(values), np.concatenate(knowledge)
    return Examples(
        scenes,
        np.array(scene, dtype=np.int32),
        actions,
        padded,
        weight,
        np.array(refuted, dtype=np.int32),
        length,
        np.array(feasible, dtype=np.bool_),
    )


def count_targets(examples: Examples) -> TargetCounts:
    """Counts of sequences by verdict, and of targets by value."""
    feasible, ones = int(examples.feasible.sum()), int(examples.targets.sum(dtype=np.float64))
    known = (examples.weight > 0) & (examples.targets == 0)
    return TargetCounts(
        scenes=len(examples.scenes),
        feasible=feasible,
        infeasible=len(examples.feasible) - feasible,
        ones=ones,
        zeros=int(examples.length.sum()) - ones,
        known_zeros=int(known.sum()),
        first_zeros=int((examples.targets[:, :1] == 0).sum()),
        known_first_zeros=int(known[:, :1].sum()),
    )


def find_shards(paths: str | Path | Iterable[str | Path]) -> list[ShardInfo]:
    """The shards that are named, and those of the folders that are named; none at all, or one twice, is an error."""
    named = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    infos: list[ShardInfo] = []
    for path in named:
        if not path.exists():
            raise DvrError(f"there is no file or folder {path}; valid are shards (*{SUFFIX}) and folders of them.")
        infos += list_shards(path) if path.is_dir() else [read_info(path)]
    if not infos:
        where = f"in {', '.join(map(str, named))}" if named else "named"
        raise DvrError(f"there is no shard {where}; valid are files *{SUFFIX} and folders of them.")
    # A folder is one sweep; different sweeps may be learned from together.
    infos.sort(key=lambda info: (str(info.path.parent.resolve()), info.footer.first, info.path.name))
    for before, info in pairwise(infos):
        if info.path.parent.resolve() == before.path.parent.resolve():
            require_agreement([before, info])
    return infos


def scenes_of(info: ShardInfo, columns: Columns) -> Iterable[tuple[int, SequenceIndex, Scene]]:
    """Row, symbols and scene of those scenes of a shard that have labels."""
    for row in np.flatnonzero(np.diff(columns.label_ends)).tolist():
        scene = scene_from_json(columns.json[row], f"{info.path}, scene {info.scenes[row]}")
        yield row, sequence_index(scene), scene


def labelled_sequences(columns: Columns, row: int, symbols: SequenceIndex, source: str) -> list[tuple[int, ...]]:
    """Actions by number of each label of a shard's scene, in the order of the labels."""
    first, stop = columns.label_ends[row : row + 2].tolist()
    ends = columns.action_ends[first : stop + 1].tolist()
    number = {name: symbols.index_of.get(name, PADDING) for name in columns.names}
    by_code = np.array([number[name] for name in columns.names] or [PADDING])
    flat: Sequence[int] = by_code[columns.action[ends[0] : ends[-1]]].tolist()
    if PADDING in flat:
        wrong = columns.names[int(columns.action[ends[0] + flat.index(PADDING)])]
        raise DvrError(f"{source} has a label with the action {wrong!r}, which its scene does not have.")
    return [tuple(flat[start - ends[0] : end - ends[0]]) for start, end in pairwise(ends)]


def _expand(
    columns: Columns,
    row: int,
    scene: Scene,
    symbols: SequenceIndex,
    completions: int,
    k_max: int,
    generator: random.Random,
    source: str,
) -> tuple[list[tuple[int, ...]], list[bool], Verdicts]:
    """Sequences of one scene, those labelled, then those drawn; their verdicts; what the labels say of any prefix."""
    labels = slice(*columns.label_ends[row : row + 2].tolist())
    refuted = columns.refuted_prefix[labels].tolist()
    labelled = labelled_sequences(columns, row, symbols, source)
    verdicts = {
        sequence: verdict
        for sequence, verdict, prefix in zip(labelled, columns.feasible[labels].tolist(), refuted, strict=True)
        if not prefix and len(sequence) <= k_max
    }
    prefixes = [sequence for sequence, is_prefix in zip(labelled, refuted, strict=True) if is_prefix]
    good, bad = ([sequence for sequence, verdict in verdicts.items() if verdict == wanted] for wanted in (True, False))
    actions = list(enumerate(symbols.grounding.actions))
    impossible = [index for index, action in actions if refute(scene, action) is not None]
    duplicates = [index for index, action in actions if is_duplicate(scene, action)]
    known = Verdicts(symbols, good, bad, prefixes, impossible, duplicates)
    for prefix in prefixes:
        wanted = completions
        for sequence in symbols.draw(prefix, k_max, generator) if wanted else ():
            if sequence not in verdicts:
                verdicts[sequence] = False
                wanted -= 1
                if not wanted:
                    break
    return list(verdicts), list(verdicts.values()), known
