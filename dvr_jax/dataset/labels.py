"""One verdict of a sweep: a sequence of actions of one scene, whether it is feasible, and what refuted it.

A prefix that a bound refutes stands for all its continuations, which are infeasible too and are not written down.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from dvr_jax.dataset.symbols import SequenceIndex
from dvr_jax.errors import DvrError

BOUNDS = ("symbolic", "pose", "sequence", "path", "check")
"""What may refute a sequence, cheapest first; "check" is the independent replay of a solved path."""


@dataclass(frozen=True, slots=True)
class Label:
    """The verdict on one sequence, or on all continuations of a prefix."""

    scene: int
    """Index of the scene in its file, or in the draw of its seed."""
    actions: tuple[str, ...]
    """`str(Action)` in order, as in "grasp(left, +x, yellow)"."""
    feasible: bool
    refuted_prefix: bool
    """True: every continuation of `actions` is infeasible too, and is not stored itself."""
    bound: str
    """The bound that refuted it, one of BOUNDS; "" if feasible."""
    violation: float
    """Largest violation as a multiple of its tolerance (above 1: infeasible; what only the check refused has
    at most 1); NaN where no NLP was solved."""

    def __str__(self) -> str:
        return f"the label of ({', '.join(self.actions)}) in scene {self.scene}"


def sort_labels(labels: Iterable[Label]) -> list[Label]:
    """By scene, then by length, then by the actions' names."""
    return sorted(labels, key=lambda label: (label.scene, len(label.actions), label.actions))


def validate_label(label: Label, symbols: SequenceIndex) -> None:
    """Raise a DvrError that names the first broken rule: verdict and bound agree, and the actions make sense there."""
    if label.feasible and (label.bound or label.refuted_prefix):
        raise DvrError(f"{label} is feasible, yet refuted by {label.bound or 'its prefix'!r}; valid is one of both.")
    if not label.feasible and label.bound not in BOUNDS:
        raise DvrError(f"{label} is infeasible by the bound {label.bound!r}; valid are {', '.join(BOUNDS)}.")
    if label.violation < 0:
        raise DvrError(f"{label} has the violation {label.violation}; valid is 0 or more, or NaN.")
    try:
        state = symbols.state_after(symbols.indices(label.actions))
    except DvrError as error:
        raise DvrError(f"{label}: {error}") from None
    if not label.refuted_prefix and not symbols.grounding.is_goal(state):
        raise DvrError(f"{label} does not reach the goal; only a refuted prefix may stop before it.")


def validate_labels(labels: Iterable[Label], symbols: SequenceIndex) -> None:
    """Rules of each label of one scene and between them: no sequence twice, none feasible that a prefix refutes."""
    labels = list(labels)
    verdicts: dict[tuple[str, ...], Label] = {}
    for label in labels:
        validate_label(label, symbols)
        if label.actions in verdicts:
            raise DvrError(f"{label} is there twice; valid is one label a sequence.")
        verdicts[label.actions] = label
    for label in labels:
        for length in range(len(label.actions) if label.feasible else 0):
            prefix = verdicts.get(label.actions[:length])
            if prefix is not None and prefix.refuted_prefix:
                raise DvrError(f"{label} is feasible, but its first {length} actions are stored as a refuted prefix.")


def same_label(first: Label, second: Label) -> bool:
    """Equality that takes NaN for equal to NaN."""
    own, other = first.violation, second.violation
    return (own == other or (math.isnan(own) and math.isnan(other))) and _words(first) == _words(second)


def _words(label: Label) -> tuple[object, ...]:
    return label.scene, label.actions, label.feasible, label.refuted_prefix, label.bound
