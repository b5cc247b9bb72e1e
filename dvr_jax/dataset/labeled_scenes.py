"""The scenes of a shard with their labels as sequences of action numbers."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dvr_jax.dataset.columns import Columns
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.sequence_index import ActionNumbers, SequenceIndex, sequence_index_of
from dvr_jax.errors import DvrError
from dvr_jax.scene.files import scene_from_json
from dvr_jax.scene.types import Scene

_UNKNOWN = -1


@dataclass(frozen=True, slots=True)
class LabeledScene:
    """A scene with the sequences and prefixes that have a label."""

    number: int
    """Index of the scene in its file, or in the draw of its seed."""

    scene: Scene
    """The scene."""

    index: SequenceIndex
    """Its actions and sequences."""

    judged: dict[ActionNumbers, bool]
    """Whether each labeled sequence is feasible; sequences are numbers of actions, in the order of the labels."""

    refuted_prefixes: list[ActionNumbers]
    """Prefixes of which all continuations are infeasible."""

    @property
    def feasible(self) -> list[ActionNumbers]:
        """The labeled sequences that are feasible."""
        return [sequence for sequence, verdict in self.judged.items() if verdict]

    @property
    def infeasible(self) -> list[ActionNumbers]:
        """The labeled sequences that are infeasible."""
        return [sequence for sequence, verdict in self.judged.items() if not verdict]


def labeled_scenes(
    info: ShardInfo,
    columns: Columns,
    solved_only: bool = False,
) -> Iterator[LabeledScene]:
    """Yield the scenes of a shard that have labels.

    Args:
        info: place and footer of the shard.
        columns: the labels of the shard.
        solved_only: whether to leave out scenes without a feasible sequence.

    Yields:
        Scenes in the order of the shard.

    Raises:
        DvrError: a scene is not valid, or a label has an action that its scene does not have.
    """
    for row in np.flatnonzero(np.diff(columns.label_ends)).tolist():
        labels = columns.labels_of(row)
        if solved_only and not columns.feasible[labels].any():
            continue

        number = info.scenes[row]
        scene = scene_from_json(columns.scene_texts[row], f"{info.path}, scene {number}")
        index = sequence_index_of(scene)
        judged: dict[ActionNumbers, bool] = {}
        refuted_prefixes: list[ActionNumbers] = []
        for sequence, feasible, is_prefix in zip(
            _sequences(columns, labels, index, str(info)),
            columns.feasible[labels].tolist(),
            columns.refuted_prefix[labels].tolist(),
            strict=True,
        ):
            if is_prefix:
                refuted_prefixes.append(sequence)
            else:
                judged[sequence] = feasible
        yield LabeledScene(number, scene, index, judged, refuted_prefixes)


def _sequences(
    columns: Columns,
    labels: slice,
    index: SequenceIndex,
    source: str,
) -> list[ActionNumbers]:
    """Return the actions of each label as numbers in the grounding of the scene."""
    number_of_name = [index.index_of.get(name, _UNKNOWN) for name in columns.names]
    ends = columns.action_ends[labels.start : labels.stop + 1].tolist()
    codes = columns.action[ends[0] : ends[-1]].tolist()
    numbers = [number_of_name[code] for code in codes]
    if _UNKNOWN in numbers:
        name = columns.names[codes[numbers.index(_UNKNOWN)]]
        raise DvrError(
            f"{source} has a label with the action {name!r}, which its scene does not have."
        )

    first = ends[0]
    return [tuple(numbers[start - first : end - first]) for start, end in pairwise(ends)]
