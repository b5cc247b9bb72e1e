"""A node of the tree of action sequences is a prefix, with its keyframe NLP, its beam and the verdicts on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Problem
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.lane_pool import NlpSolution


class Evidence(NamedTuple):
    """An NLP and an infeasible point of it."""

    problem: Problem
    """The NLP."""

    solution: NlpSolution
    """The best point that was found."""


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

    source: Node | None = None
    """The node whose keyframes refuted this one, such as that of a window; None if it is the node itself."""

    evidence: Evidence | None = None
    """The NLP and the point of least violation among those that failed; None if no NLP was solved in vain."""

    solved: bool | None = None
    """Whether there is an accepted path; None if no path has been tried."""

    is_retried: bool = False
    """Whether the sequence bound was computed once more after it had refuted the prefix."""

    children: list[Node] | None = None
    """The prefixes one action longer, once the node is expanded."""

    children_limit: int = 0
    """Largest number of actions of the sequences for which the node was expanded."""

    def refute(self, bound: str, violation: float, source: Node | None = None) -> None:
        """Record that a bound refutes this prefix, and therefore all its continuations.

        Args:
            bound: Name of the bound.
            violation: Least violation under it, as a multiple of its tolerance.
            source: The node whose keyframes were judged; None if it is this one.
        """
        self.source = source
        self.feasible = False
        self.refuted_by = bound
        self.violation = violation

    def add_evidence(self, problem: Problem, solution: NlpSolution) -> None:
        """Keep the point of an NLP that was solved in vain if its violation is the least so far.

        Args:
            problem: The NLP.
            solution: Its infeasible solution.
        """
        known = self.evidence
        if known is None or solution.relative_violation < known.solution.relative_violation:
            self.evidence = Evidence(problem, solution)

    @property
    def deserves_second_look(self) -> bool:
        """Whether the sequence bound has refuted this prefix once, and not twice."""
        return self.feasible is False and self.refuted_by == "sequence" and not self.is_retried

    def reopen(self) -> None:
        """Withdraw the verdict on this prefix."""
        self.feasible = None
        self.refuted_by = ""
        self.violation = math.nan

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
