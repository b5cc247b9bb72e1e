"""Labels: the verdict of a sweep on one sequence of actions of one scene, and the bound that refuted it.

A prefix that a bound refutes stands for all its continuations. These are infeasible too and are not written down.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from dvr_jax.dataset.sequence_index import SequenceIndex
from dvr_jax.errors import DvrError

BOUNDS = ("symbolic", "pose", "sequence", "path", "check")
"""The bounds that may refute a sequence, cheapest first; "check" is the independent replay of a solved path."""


@dataclass(frozen=True, slots=True)
class Label:
    """The verdict on one sequence, or on all continuations of a prefix."""

    scene: int
    """Index of the scene in its file, or in the draw of its seed."""

    actions: tuple[str, ...]
    """`str(Action)` of each action, as in "grasp(left, +x, yellow)"."""

    feasible: bool
    """Whether the sequence is feasible."""

    refuted_prefix: bool
    """Whether every continuation of `actions` is infeasible too; such continuations have no label of their own."""

    bound: str
    """The bound that refuted the sequence, one of BOUNDS; "" if the sequence is feasible."""

    violation: float
    """Largest violation as a multiple of its tolerance, or NaN where no NLP was solved.

    A violation above 1 is infeasible. A sequence that only the check refused has a violation of at most 1.
    """

    def __str__(self) -> str:
        return f"the label of ({', '.join(self.actions)}) in scene {self.scene}"


def sort_labels(labels: Iterable[Label]) -> list[Label]:
    """Sort labels by scene, then by length, then by the names of the actions."""
    return sorted(labels, key=lambda label: (label.scene, len(label.actions), label.actions))


def validate_label(label: Label, index: SequenceIndex) -> None:
    """Check that verdict and bound of a label agree, and that its actions make sense in the scene.

    Args:
        label: the label to check.
        index: the actions and sequences of the scene of the label.

    Raises:
        DvrError: a rule is broken; the message names the first one.
    """
    if label.feasible and (label.bound or label.refuted_prefix):
        raise DvrError(
            f"{label} is feasible, yet refuted by {label.bound or 'its prefix'!r}; valid is one of both."
        )
    if not label.feasible and label.bound not in BOUNDS:
        raise DvrError(
            f"{label} is infeasible by the bound {label.bound!r}; valid are {', '.join(BOUNDS)}."
        )
    if label.violation < 0:
        raise DvrError(f"{label} has the violation {label.violation}; valid is 0 or more, or NaN.")

    try:
        state = index.state_after(index.indices(label.actions))
    except DvrError as error:
        raise DvrError(f"{label}: {error}") from None
    if not label.refuted_prefix and not index.grounding.is_goal(state):
        raise DvrError(
            f"{label} does not reach the goal; only a refuted prefix may stop before it."
        )


def validate_labels(labels: Iterable[Label], index: SequenceIndex) -> None:
    """Check the labels of one scene, each by itself and all of them together.

    Args:
        labels: all labels of one scene.
        index: the actions and sequences of the scene.

    Raises:
        DvrError: a label breaks a rule, a sequence has two labels, or a feasible sequence begins with a refuted prefix.
    """
    label_of: dict[tuple[str, ...], Label] = {}
    for label in labels:
        validate_label(label, index)
        if label.actions in label_of:
            raise DvrError(f"{label} is there twice; valid is one label a sequence.")
        label_of[label.actions] = label

    refuted = {label.actions for label in label_of.values() if label.refuted_prefix}
    for label in label_of.values():
        if label.feasible:
            _require_no_refuted_prefix(label, refuted)


def _require_no_refuted_prefix(label: Label, refuted: set[tuple[str, ...]]) -> None:
    """Raise a DvrError if a feasible sequence begins with a refuted prefix."""
    for length in range(len(label.actions)):
        if label.actions[:length] in refuted:
            raise DvrError(
                f"{label} is feasible, but its first {length} actions are stored as a refuted prefix."
            )


def same_label(first: Label, second: Label) -> bool:
    """Return whether two labels are equal, where NaN equals NaN.

    Args:
        first: one label.
        second: the other label.

    Returns:
        True if all fields are equal.
    """
    both_nan = math.isnan(first.violation) and math.isnan(second.violation)
    same_violation = first.violation == second.violation or both_nan
    return same_violation and _all_but_violation(first) == _all_but_violation(second)


def _all_but_violation(label: Label) -> tuple[object, ...]:
    return label.scene, label.actions, label.feasible, label.refuted_prefix, label.bound
