"""The verdicts of a shard's labels as numbers, with each distinct verdict of a scene written once.

A bound refutes many sequences by the same keyframes, with the same violation: 100,000 labels have 6,000 to 12,000
distinct verdicts.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt64

from dvr_jax.dataset.columns import ends_of, row_of_items
from dvr_jax.dataset.labels import BOUNDS

NEW = 0
"""In `CompactVerdicts.number`: the verdict is the next of the distinct ones."""

_BOUNDS = ("", *BOUNDS)


@dataclass(frozen=True, slots=True)
class Verdicts:
    """Verdicts as arrays, with the fields of `dvr_jax.dataset.labels.Label`; feasible is what has the bound ""."""

    refuted_prefix: Bool[np.ndarray, " verdicts"]
    bound: list[str]
    violation: Float32[np.ndarray, " verdicts"]

    def take(self, places: Int64[np.ndarray, " taken"]) -> "Verdicts":
        """Return the verdicts at these places."""
        return Verdicts(
            refuted_prefix=self.refuted_prefix[places],
            bound=[self.bound[place] for place in places.tolist()],
            violation=self.violation[places],
        )


@dataclass(frozen=True, slots=True)
class CompactVerdicts:
    """The verdicts of all labels of a shard, scene by scene."""

    number: Int64[np.ndarray, " labels"]
    """NEW, or 1 more than the index of a distinct verdict of the scene that a label before has too."""

    distinct: Verdicts
    """The distinct verdicts of each scene, in the order in which labels first have them."""

    ends: Int64[np.ndarray, " scenes_plus_one"]
    """First distinct verdict of each scene, and the number of distinct verdicts at the end."""


def compact_verdicts(
    verdicts: Verdicts,
    label_ends: Int64[np.ndarray, " scenes_plus_one"],
) -> CompactVerdicts:
    """Write each distinct verdict of a scene once.

    Args:
        verdicts: one for each label.
        label_ends: first label of each scene, and the number of labels at the end.

    Returns:
        The compact form, with labels in the same order.
    """
    keys = _keys(verdicts)
    numbers = np.empty(len(keys), dtype=np.int64)
    first_labels: list[int] = []
    counts: list[int] = []
    for start, stop in pairwise(label_ends.tolist()):
        _, first, inverse = np.unique(keys[start:stop], return_index=True, return_inverse=True)

        # `unique` sorts by key; wanted is the order of first occurrence.
        rank = np.argsort(np.argsort(first))
        own_numbers = rank[inverse] + 1
        own_numbers[first] = NEW
        numbers[start:stop] = own_numbers
        first_labels += (start + np.sort(first)).tolist()
        counts.append(len(first))

    distinct = verdicts.take(np.array(first_labels, dtype=np.int64))
    return CompactVerdicts(numbers, distinct, ends_of(np.array(counts, dtype=np.int64)))


def expand_verdicts(
    compact: CompactVerdicts,
    label_ends: Int64[np.ndarray, " scenes_plus_one"],
) -> Verdicts:
    """Give each label its verdict.

    Args:
        compact: the compact form.
        label_ends: first label of each scene, and the number of labels at the end.

    Returns:
        One verdict for each label.

    Raises:
        ValueError: the numbers contradict each other.
    """
    scene = row_of_items(label_ends)
    is_new = compact.number == NEW
    new_in_scene = np.bincount(scene[is_new], minlength=len(label_ends) - 1)
    if not np.array_equal(new_in_scene, np.diff(compact.ends)):
        raise ValueError("the number of distinct verdicts is not that of the labels")

    # New verdicts follow one another through the whole shard; the others are counted within their scene.
    known = np.cumsum(is_new)
    place = np.where(is_new, known - 1, compact.ends[scene] + compact.number - 1)
    if np.any(place >= known):
        raise ValueError("a label has a verdict that no label before has")
    return compact.distinct.take(place)


def _keys(verdicts: Verdicts) -> UInt64[np.ndarray, " verdicts"]:
    """Pack each verdict into one number, so that verdicts are equal if their numbers are; NaN equals NaN."""
    code_of_bound = {bound: code for code, bound in enumerate(_BOUNDS)}
    codes = np.array([code_of_bound[bound] for bound in verdicts.bound], dtype=np.uint64)
    bits = verdicts.violation.view(np.uint32).astype(np.uint64)
    return (
        (bits << np.uint64(4)) | (codes << np.uint64(1)) | verdicts.refuted_prefix.astype(np.uint64)
    )
