"""A node of the tree of action sequences: a prefix, and what is known of it."""

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
    """Verdict of the sequence bound, or False by the pose bound; None: not computed."""

    refuted_by: str = ""
    """The bound that refuted the prefix: "symbolic", "pose", "sequence", "path", or "check" for a path that only the
    check refused."""

    violation: float = math.nan
    """Least violation that an NLP under the refuting bound ended with, as a multiple of its tolerance."""

    solved: bool | None = None
    """Whether there is an accepted path; None: not tried."""

    children: list[Node] | None = None
    """The prefixes one action longer, once the node is expanded."""

    def refute(self, bound: str, violation: float) -> None:
        """Note that a bound of keyframes refutes this prefix, and so all its continuations.

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
        """The prefix of this length, or the node itself where it is shorter."""
        node = self
        while node.depth > depth and node.parent is not None:
            node = node.parent
        return node
