"""The labels of a shard as flat arrays, without an object for each label.

A shard holds a hundred thousand labels. As objects they take ten times the memory and most of the time of reading.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64

from dvr_jax.dataset.labels import Label

VIOLATION_BITS = 10
"""Binary digits kept of a violation: the verdict is in `feasible`, and noise does not compress."""

FLOAT32_EXPONENT = 127
"""Violations from 2^127 on count as infinite."""


@dataclass(frozen=True, slots=True)
class Columns:
    """The scenes of a shard, and its labels sorted by scene, then by length, then by the names of the actions."""

    scene_texts: list[str]
    """Each scene as in a scene file."""

    label_ends: Int64[np.ndarray, " scenes_plus_one"]
    """First label of each scene, and the number of labels at the end."""

    action_ends: Int64[np.ndarray, " labels_plus_one"]
    """First action of each label, and the number of actions at the end."""

    names: list[str]
    """Distinct names of actions."""

    action: Int64[np.ndarray, " actions"]
    """Index into `names` of each action of each label."""

    feasible: Bool[np.ndarray, " labels"]
    """As `Label.feasible`."""

    refuted_prefix: Bool[np.ndarray, " labels"]
    """As `Label.refuted_prefix`."""

    bound: list[str]
    """As `Label.bound`."""

    violation: Float32[np.ndarray, " labels"]
    """As `Label.violation`: multiples of the tolerance."""

    def labels_of(self, row: int) -> slice:
        """Return where the labels of a scene lie; `row` counts the scenes of the shard from 0."""
        return slice(int(self.label_ends[row]), int(self.label_ends[row + 1]))


def columns_of(scene_texts: Sequence[str], labels: Sequence[Label], first_scene: int) -> Columns:
    """Turn labels into arrays; violations are rounded.

    Args:
        scene_texts: the scenes of the shard as JSON.
        labels: sorted by scene, then by length, then by the names of the actions.
        first_scene: index of the first scene.

    Returns:
        The arrays.
    """
    names = sorted({name for label in labels for name in label.actions})
    code_of = {name: code for code, name in enumerate(names)}
    codes = [code_of[name] for label in labels for name in label.actions]
    rows = np.array([label.scene - first_scene for label in labels], dtype=np.int64)

    return Columns(
        scene_texts=list(scene_texts),
        label_ends=ends_of(np.bincount(rows, minlength=len(scene_texts))),
        action_ends=ends_of(np.array([len(label.actions) for label in labels], dtype=np.int64)),
        names=names,
        action=np.array(codes, dtype=np.int64),
        feasible=np.array([label.feasible for label in labels], dtype=np.bool_),
        refuted_prefix=np.array([label.refuted_prefix for label in labels], dtype=np.bool_),
        bound=[label.bound for label in labels],
        violation=np.array(
            [round_violation(label.violation) for label in labels], dtype=np.float32
        ),
    )


def labels_in(columns: Columns, first_scene: int) -> tuple[Label, ...]:
    """Turn arrays into labels.

    Args:
        columns: the arrays.
        first_scene: index of the first scene.

    Returns:
        The labels in the order of the arrays.
    """
    names = [columns.names[code] for code in columns.action.tolist()]
    scenes = row_of_items(columns.label_ends) + first_scene
    labels = zip(
        scenes.tolist(),
        columns.action_ends[:-1].tolist(),
        columns.action_ends[1:].tolist(),
        columns.feasible.tolist(),
        columns.refuted_prefix.tolist(),
        columns.bound,
        columns.violation.tolist(),
        strict=True,
    )
    return tuple(
        Label(scene, tuple(names[start:end]), feasible, refuted_prefix, bound, violation)
        for scene, start, end, feasible, refuted_prefix, bound, violation in labels
    )


def ends_of(counts: Int64[np.ndarray, " lists"]) -> Int64[np.ndarray, " lists_plus_one"]:
    """Return where lists of these lengths begin when they lie end to end, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def row_of_items(ends: Int64[np.ndarray, " lists_plus_one"]) -> Int64[np.ndarray, " items"]:
    """Return for each item of lists that lie end to end the number of its list."""
    return np.repeat(np.arange(len(ends) - 1), np.diff(ends))


def round_violation(violation: float) -> float:
    """Round a violation to VIOLATION_BITS binary digits; NaN and infinity stay what they are."""
    mantissa, exponent = math.frexp(violation)
    if math.isnan(violation):
        return violation
    if math.isinf(violation) or exponent > FLOAT32_EXPONENT:
        return math.inf

    rounded = round(mantissa * 2**VIOLATION_BITS)
    return float(np.float32(math.ldexp(rounded, exponent - VIOLATION_BITS)))
