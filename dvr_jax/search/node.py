"""A node of the tree of action sequences is a prefix, with its keyframe NLP, its beam and the verdicts on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Problem
from dvr_jax.seeds.keyframe_beam import KeyframeBeam


@dataclass(slots=True, eq=False)
class Node:
    """A prefix: a sequence of applicable actions."""

    actions: tuple[Action, ...]
    """The actions of the prefix."""

    state: int
    """Symbolic state after the actions."""

    parent: Node | None
    """The prefix without its last action; None for the empty prefix."""

    reaches_goal: bool
    """Whether the goal holds after the actions."""

    problem: Problem | None = None
    """Keyframe NLP of the prefix, once it is transcribed."""

    beam: KeyframeBeam | None = None
    """Keyframe candidates of the prefix, once they are sampled."""

    feasible: bool | None = None
    """Verdict of the sequence bound, or False if the pose bound refuted the prefix; None if neither is known."""

    refuted_by: str = ""
    """The bound that refuted the prefix: "symbolic", "pose", "sequence", "path", or "check" for a path that only the
    check refused."""

    violation: float = math.nan
    """Least relative violation (a multiple of the tolerance) among the NLPs of the refuting bound; NaN if unknown."""

    solved: bool | None = None
    """Whether there is an accepted path; None if no path has been tried."""

    is_retried: bool = False
    """Whether the sequence bound was computed once more after it had refuted the prefix."""

    children: list[Node] | None = None
    """The prefixes one action longer, once the node is expanded."""

    children_limit: int = 0
    """Largest number of actions of the sequences for which the node was expanded."""

    def refute(self, bound: str, violation: float) -> None:
        """Record that a bound refutes this prefix, and therefore all its continuations.

        Args:
            bound: Name of the bound.
            violation: Least violation under it, as a multiple of its tolerance.
        """
        self.feasible = False
        self.refuted_by = bound
        self.violation = violation

    @property
    def depth(self) -> int:
        """Number of actions."""
        return len(self.actions)

    def ancestor(self, depth: int) -> Node:
        """Return the node of this node's prefix of the given length, or the node itself if it is shorter."""
        node = self
        while node.depth > depth and node.parent is not None:
            node = node.parent
        return node
