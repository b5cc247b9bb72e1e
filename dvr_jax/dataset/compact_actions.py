"""The actions of a shard's labels as small numbers, without those that a label shares with the label before it.

The labels of a scene are sorted by length and then by their actions from the last one to the first. Sequences that end
in the same actions are mostly refuted by the same keyframes, so this order puts labels side by side that share both
their last actions and their verdict.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Int64

from dvr_jax.dataset.columns import Columns, ends_of, row_of_items

NO_ACTION = -1
"""Fills a table of actions behind the end of a label."""


@dataclass(frozen=True, slots=True)
class CompactActions:
    """The actions of all labels of a shard, scene by scene."""

    names: list[list[str]]
    """The distinct actions of the labels of each scene, sorted."""

    length: Int64[np.ndarray, " labels"]
    """Number of actions of each label."""

    shared: Int64[np.ndarray, " labels"]
    """Number of last actions that the label before, of the same scene, has too."""

    action: Int64[np.ndarray, " kept_actions"]
    """The other actions of each label, the last one first, as indices into the names of the scene."""

    label_ends: Int64[np.ndarray, " scenes_plus_one"]
    """First label of each scene, and the number of labels at the end."""

    @property
    def action_ends(self) -> Int64[np.ndarray, " scenes_plus_one"]:
        """First kept action of each scene, and the number of kept actions at the end."""
        before_label = ends_of(self.length - self.shared)
        return before_label[self.label_ends]


@dataclass(frozen=True, slots=True)
class ExpandedActions:
    """The actions of all labels, sorted by scene, then by length, then by the names of the actions."""

    names: list[str]
    """Distinct names of actions, sorted."""

    action: Int64[np.ndarray, " actions"]
    """Index into `names` of each action of each label."""

    action_ends: Int64[np.ndarray, " labels_plus_one"]
    """First action of each label, and the number of actions at the end."""

    order: Int64[np.ndarray, " labels"]
    """The place of each label in the compact form."""


def compact_actions(columns: Columns) -> tuple[CompactActions, Int64[np.ndarray, " labels"]]:
    """Leave out the actions that a label shares with the label before it.

    Args:
        columns: the labels of a shard.

    Returns:
        The compact form, and the place of each of its labels in `columns`.
    """
    names, action = _number_by_scene(columns)
    length = np.diff(columns.action_ends)
    scene = row_of_items(columns.label_ends)

    # The order brings labels with the same last actions side by side.
    from_last = _reverse_rows(_table_of(action, length), length)
    order = np.lexsort((*from_last.T[::-1], length, scene))
    from_last = from_last[order]
    length = length[order]

    # A label shares actions up to the first difference; the first label of a scene shares none.
    is_equal = np.zeros(from_last.shape, dtype=np.bool_)
    is_equal[1:] = from_last[1:] == from_last[:-1]
    is_equal[1:] &= (scene[1:] == scene[:-1])[:, None]
    shared = np.minimum(np.logical_and.accumulate(is_equal, axis=1).sum(axis=1), length)

    kept = from_last[_is_between(shared, length, from_last.shape[1])]
    return CompactActions(names, length, shared, kept, columns.label_ends), order


def expand_actions(compact: CompactActions) -> ExpandedActions:
    """Write out all actions, and sort the labels by name.

    Args:
        compact: the compact form.

    Returns:
        The actions of the labels.

    Raises:
        ValueError: the numbers contradict each other.
    """
    length = compact.length
    from_last = _fill(compact)
    is_action = _is_between(np.zeros_like(length), length, from_last.shape[1])

    # From the names of the scene to the names of the shard.
    number_of_names = np.array([len(own) for own in compact.names], dtype=np.int64)
    scene = row_of_items(compact.label_ends)
    is_too_large = from_last >= number_of_names[scene][:, None]
    is_missing = is_action & (from_last == NO_ACTION)
    if np.any(is_too_large | is_missing):
        raise ValueError("an action is none of its scene")
    names = sorted({name for own in compact.names for name in own})
    code_of = {name: code for code, name in enumerate(names)}
    codes = np.array([code_of[name] for own in compact.names for name in own], dtype=np.int64)
    first_name = ends_of(number_of_names)[scene]
    place = from_last + first_name[:, None]
    from_last[is_action] = codes[place[is_action]]

    # Codes are in the order of names, so labels are sorted by their codes.
    table = _reverse_rows(from_last, length)
    order = np.lexsort((*table.T[::-1], length, scene))
    table = table[order]
    return ExpandedActions(names, table[table != NO_ACTION], ends_of(length[order]), order)


def _number_by_scene(columns: Columns) -> tuple[list[list[str]], Int64[np.ndarray, " actions"]]:
    """Number the actions of each scene in the order of their names."""
    names: list[list[str]] = []
    action = np.empty_like(columns.action)
    ends = columns.action_ends[columns.label_ends].tolist()
    rank_of_name = np.argsort(np.argsort(np.array(columns.names, dtype=object)))
    name_of_rank = sorted(columns.names)
    for start, stop in pairwise(ends):
        ranks, numbers = np.unique(rank_of_name[columns.action[start:stop]], return_inverse=True)
        names.append([name_of_rank[rank] for rank in ranks.tolist()])
        action[start:stop] = numbers
    return names, action


def _is_between(
    start: Int64[np.ndarray, " labels"],
    stop: Int64[np.ndarray, " labels"],
    steps: int,
) -> Bool[np.ndarray, "labels steps"]:
    """Return for each label which of `steps` places lie from its start on and before its stop."""
    place = np.arange(steps)
    return (place >= start[:, None]) & (place < stop[:, None])


def _table_of(
    action: Int64[np.ndarray, " actions"],
    length: Int64[np.ndarray, " labels"],
) -> Int64[np.ndarray, "labels steps"]:
    """Write the actions of each label into a row, with NO_ACTION behind its end."""
    steps = int(length.max(initial=0))
    table = np.full((len(length), steps), NO_ACTION, dtype=np.int64)
    table[_is_between(np.zeros_like(length), length, steps)] = action
    return table


def _reverse_rows(
    table: Int64[np.ndarray, "labels steps"],
    length: Int64[np.ndarray, " labels"],
) -> Int64[np.ndarray, "labels steps"]:
    """Reverse the actions of each row; NO_ACTION stays behind the end."""
    steps = table.shape[1]
    source = length[:, None] - 1 - np.arange(steps)
    reversed_rows = np.take_along_axis(table, np.maximum(source, 0), axis=1)
    return np.where(source >= 0, reversed_rows, NO_ACTION)


def _fill(compact: CompactActions) -> Int64[np.ndarray, "labels steps"]:
    """Write out the actions of each label from the last one to the first, as indices into the names of its scene."""
    length = compact.length
    shared = compact.shared
    first_labels = compact.label_ends[:-1][np.diff(compact.label_ends) > 0]
    if np.any(shared > length) or np.any(shared[first_labels]):
        raise ValueError("a label shares actions that it does not have")

    steps = int(length.max(initial=0))
    is_kept = _is_between(shared, length, steps)
    if is_kept.sum() != len(compact.action):
        raise ValueError("the number of actions is not that of the labels")

    # An action that is shared is that of the last label before that does not share it.
    table = np.full(is_kept.shape, NO_ACTION, dtype=np.int64)
    table[is_kept] = compact.action
    label = np.arange(len(length))
    for step in range(steps):
        source = np.maximum.accumulate(np.where(shared <= step, label, 0))
        table[:, step] = table[source, step]
    return table
