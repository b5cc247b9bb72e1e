"""Feasibility of given action sequences, in batches, for those who want no search.

from dvr_jax.planning.feasibility import feasibility
from dvr_jax.scene.files import load_scene

scene = load_scene("data/scenes/figure1.json")
handovers = [
    [f"grasp(left, {give}, yellow)", f"grasp(right, {take}, yellow)", "place(right, yellow, goal)"]
    for give in ("+x", "-x", "+y", "-y")
    for take in ("+x", "-x", "+y", "-y")
]
for verdict in feasibility(scene, handovers):
    print(verdict)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import jax

from dvr_jax.checker.replay import check_motion
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, LogicError
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.path_motion import interpolate
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.run import Run
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone
from dvr_jax.solver.engine import NlpSolution


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of one action sequence of a scene."""

    actions: tuple[Action, ...]
    feasible: bool
    """There is a path within the NLP's tolerances that the independent check accepts. False is the verdict of local
    optimisation from many starts, not a proof."""
    bound: str
    """The bound that refuted the sequence: "symbolic" (too large for a gripper, whatever the motion), "pose",
    "sequence", "path" or "check"; "" if feasible."""
    violation: float
    """Largest violation as a multiple of its tolerance; NaN where no NLP was solved."""
    motion: Motion | None = field(default=None, compare=False, repr=False)
    """What the check accepted, if the sequence is feasible."""

    def __str__(self) -> str:
        words = "feasible" if self.feasible else f"infeasible by the {self.bound} bound"
        return f"{' '.join(map(str, self.actions))}: {words}"


def feasibility(scene: Scene, sequences: Sequence[Sequence[Action | str]], seed: int = 0) -> list[Verdict]:
    """Verdicts on sequences of a scene, in their order; prefixes that sequences share are judged once.

    Args:
        scene: a valid scene.
        sequences: of actions, or of their names as in "grasp(left, +x, yellow)"; each reaches the goal with its last
        action and not before.
        seed: of all sampling; the same seed and sequences give the same verdicts. (What proves one feasible may prove a
        relaxation of another: together, more may be found feasible than one by one.)

    Raises:
        LogicError: a sequence that the logic does not allow.
    """
    with jax.enable_x64(True):
        return run_alone(judge(scene, sequences, seed))


def judge(scene: Scene, sequences: Sequence[Sequence[Action | str]], seed: int = 0) -> Steps[list[Verdict]]:
    """The same as a computation that `dvr_jax.search.work.run_together` runs side by side with those of other
    scenes."""
    if seed < 0:
        raise DvrError(f"the seed is {seed}; valid is a whole number from 0.")
    parsed = [
        tuple(Action.parse(action) if isinstance(action, str) else action for action in sequence)
        for sequence in sequences
    ]
    tree = SequenceTree(scene, max(map(len, parsed), default=1), seed)
    nodes: dict[tuple[Action, ...], Node] = {(): tree.root}
    for actions in parsed:
        try:
            states = tree.grounding.check_sequence(actions)
        except LogicError as error:
            raise LogicError(f"{' '.join(map(str, actions)) or 'the empty sequence'}: {error}") from None
        for depth in range(1, len(actions) + 1):
            prefix = actions[:depth]
            if prefix not in nodes:
                nodes[prefix] = Node(prefix, states[depth], nodes[prefix[:-1]], reaches_goal=depth == len(actions))
    motions: dict[Node, Motion] = {}

    def accept(node: Node, path: NlpSolution) -> bool:
        motions[node] = motion_of(scene, node, path)
        return check_motion(scene, node.actions, motions[node]).passed

    run = Run(tree, accept, lambda line: None)
    leaves = [nodes[actions] for actions in dict.fromkeys(parsed)]
    possible = [leaf for leaf in leaves if not tree.refute_by_constants(leaf)]
    for leaf in (yield from run.judge_leaves(possible)):
        yield from run.try_path(leaf)
    return [_verdict(nodes[actions], motions) for actions in parsed]


def _verdict(leaf: Node, motions: Mapping[Node, Motion]) -> Verdict:
    # A refuted prefix refutes what goes on from it.
    culprit: Node | None = leaf
    while culprit is not None and not culprit.refuted_by:
        culprit = culprit.parent
    if culprit is None:
        return Verdict(leaf.actions, bool(leaf.solved), "", leaf.violation, motions.get(leaf))
    return Verdict(leaf.actions, False, culprit.refuted_by, culprit.violation)


def passes_check(scene: Scene, node: Node, path: NlpSolution) -> bool:
    """Whether the independent check accepts a path."""
    return check_motion(scene, node.actions, motion_of(scene, node, path)).passed


def motion_of(scene: Scene, node: Node, path: NlpSolution) -> Motion:
    """The motion of a path, at the rate of the check."""
    assert node.problem is not None
    return interpolate(scene, node.problem, path.q, path.m)
