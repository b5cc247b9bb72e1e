"""Feasibility of given action sequences, judged in batches, without a search.

from dvr_jax import feasibility, load_scene

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
from dataclasses import dataclass, field, replace

import jax

from dvr_jax.checker import CHECKS, OperatorCheck, check_motion
from dvr_jax.errors import OptionError
from dvr_jax.logic import Action, LogicError
from dvr_jax.motion.motion import Motion
from dvr_jax.operators import OPERATORS, Operator
from dvr_jax.planning.arguments import describe_value, parse_actions, require_integer, require_scene
from dvr_jax.planning.path_motion import interpolate
from dvr_jax.scene.types import Scene
from dvr_jax.search.counterfactual import confirm
from dvr_jax.search.explanation import explain_node
from dvr_jax.search.node import Node
from dvr_jax.search.reasons import Reason
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone
from dvr_jax.solver.lane_pool import NlpSolution


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of one action sequence of a scene."""

    actions: tuple[Action, ...]
    """The sequence."""
    feasible: bool
    """Whether a path was found that meets the NLP's tolerances and that the independent check accepts. For a sequence
    that does not reach the goal, whether keyframes were found.

    False is the verdict of local optimization from many starts, not a proof.
    """
    bound: str
    """The bound that refuted the sequence; empty if it is feasible.

    "symbolic" means that an object is too large for a gripper, whatever the motion. The others are "pose", "sequence",
    "path" and "check".
    """
    violation: float
    """Largest violation of a constraint as a multiple of its tolerance; NaN where no NLP was solved."""
    reason: Reason | None = None
    """What is impossible, at which action, and by how much; None if the sequence is feasible."""
    refuted: tuple[Action, ...] = ()
    """The shortest beginning of the sequence that is refuted; empty if the sequence is feasible."""
    motion: Motion | None = field(default=None, compare=False, repr=False)
    """Motion that the check accepted; None unless the sequence is feasible."""

    def __str__(self) -> str:
        """Return the actions and the verdict in one line."""
        verdict = "feasible" if self.feasible else f"infeasible by the {self.bound} bound"
        why = "" if self.reason is None else f" ({self.reason.sentence.rstrip('.')})"
        return f"{' '.join(map(str, self.actions))}: {verdict}{why}"


def feasibility(
    scene: Scene,
    sequences: Sequence[Sequence[Action | str]],
    seed: int = 0,
    operators: Sequence[Operator] = OPERATORS,
    checks: Sequence[OperatorCheck] = CHECKS,
    confirm_reasons: bool = False,
) -> list[Verdict]:
    """Judge action sequences of a scene; prefixes that sequences share are judged once.

    Args:
        scene: Valid scene.
        sequences: Sequences of actions, each as `Action` or as text such as "grasp(left, +x, yellow)". A sequence may
            reach the goal with its last action, but not before. Of one that does not reach the goal, only the keyframes
            are judged.
        seed: Seed of all sampling, from 0. The same seed and sequences give the same verdicts. What proves one
            sequence feasible may prove a relaxation of another one, so more sequences may be found feasible together
            than one by one.
        operators: Operators that actions may be of.
        checks: Their halves in the independent check.
        confirm_reasons: Whether reasons are confirmed: scenes in which one body is gone, or in which an object or the
            region is nearer or farther, are judged, and the smallest change that makes the actions possible is the
            reason. It takes some tenths of a second for each reason.

    Returns:
        One verdict for each sequence, in their order.

    Raises:
        OptionError: An argument has a wrong type or value.
        LogicError: The logic does not allow a sequence, or it goes on after the goal.
        DvrError: The arms are in collision in the scene's initial state.
    """
    with jax.enable_x64(True):
        verdicts = run_alone(judge(scene, sequences, seed, operators, checks))
        return _confirmed(scene, verdicts, seed, operators) if confirm_reasons else verdicts


def _confirmed(
    scene: Scene, verdicts: list[Verdict], seed: int, operators: Sequence[Operator]
) -> list[Verdict]:
    """Return verdicts with confirmed reasons; sequences that are refuted by the same actions share a reason."""
    cases = {verdict.refuted: verdict.reason for verdict in verdicts if verdict.reason is not None}
    reasons = dict(zip(cases, confirm(scene, list(cases.items()), seed, operators), strict=True))
    return [
        verdict if verdict.reason is None else replace(verdict, reason=reasons[verdict.refuted])
        for verdict in verdicts
    ]


def judge(
    scene: Scene,
    sequences: Sequence[Sequence[Action | str]],
    seed: int = 0,
    operators: Sequence[Operator] = OPERATORS,
    checks: Sequence[OperatorCheck] = CHECKS,
) -> Steps[list[Verdict]]:
    """Judge action sequences as `feasibility` does, as a computation that can share batches with others.

    `dvr_jax.search.work.run_together` runs such computations of several scenes side by side.

    Args:
        scene: Valid scene.
        sequences: Sequences of actions.
        seed: Seed of all sampling, from 0.
        operators: Operators that actions may be of.
        checks: Their halves in the independent check.

    Returns:
        A generator that asks for work and ends with the verdicts.

    Raises:
        OptionError: An argument has a wrong type or value.
        LogicError: The logic does not allow a sequence, or it goes on after the goal.
        DvrError: The arms are in collision in the scene's initial state.
    """
    scene = require_scene(scene)
    seed = require_integer("the seed", seed, least=0)
    parsed = _parse_sequences(sequences)

    longest = max(map(len, parsed), default=1)
    tree = SequenceTree(scene, longest, seed, operators=operators)
    leaves = _grow(tree, parsed)

    motions: dict[Node, Motion] = {}

    def accept(node: Node, path: NlpSolution) -> bool:
        motions[node] = motion_of(scene, node, path)
        return check_motion(scene, node.actions, motions[node], checks).passed

    # Constants of the scene refute some sequences at once; the bounds judge the others, from cheap to expensive.
    session = SearchSession(tree, accept, progress=lambda line: None)
    possible = [leaf for leaf in leaves.values() if not tree.refute_by_constants(leaf)]
    passed = yield from session.judge_leaves(possible)
    for leaf in passed:
        if leaf.reaches_goal:
            yield from session.try_path(leaf)

    return [_verdict(tree, leaves[actions], motions) for actions in parsed]


def _parse_sequences(sequences: object) -> list[tuple[Action, ...]]:
    """Return the sequences with their actions parsed."""
    valid = "valid is a list of sequences, such as [['grasp(left, +x, yellow)', 'place(left, yellow, goal)']]"

    if isinstance(sequences, str) or not isinstance(sequences, Sequence):
        raise OptionError(f"the list of sequences is {describe_value(sequences)}; {valid}.")

    for number, sequence in enumerate(sequences, start=1):
        if isinstance(sequence, (str, Action)):
            raise OptionError(f"sequence {number} is the single action {str(sequence)!r}; {valid}.")

    return [
        parse_actions(f"sequence {number}", sequence)
        for number, sequence in enumerate(sequences, start=1)
    ]


def _grow(
    tree: SequenceTree, sequences: Sequence[tuple[Action, ...]]
) -> dict[tuple[Action, ...], Node]:
    """Make the nodes of sequences and of their prefixes; return the leaves by their sequence."""
    nodes: dict[tuple[Action, ...], Node] = {(): tree.root}

    for actions in sequences:
        try:
            # An empty sequence is refused, because there is nothing to judge.
            check = tree.grounding.check_prefix if actions else tree.grounding.check_sequence
            states = check(actions)
        except LogicError as error:
            name = " ".join(map(str, actions)) or "the empty sequence"
            raise LogicError(f"{name}: {error}") from None

        for depth in range(1, len(actions) + 1):
            prefix = actions[:depth]
            if prefix not in nodes:
                parent = nodes[prefix[:-1]]
                reaches_goal = tree.grounding.is_goal(states[depth])
                nodes[prefix] = Node(prefix, states[depth], parent, reaches_goal)

    return {actions: nodes[actions] for actions in sequences}


def _verdict(tree: SequenceTree, leaf: Node, motions: Mapping[Node, Motion]) -> Verdict:
    """Return the verdict on a sequence; a prefix that is refuted refutes it too."""
    refuted: Node | None = leaf
    while refuted is not None and not refuted.refuted_by:
        refuted = refuted.parent

    if refuted is not None:
        reason = explain_node(tree, refuted)
        return Verdict(
            leaf.actions, False, refuted.refuted_by, refuted.violation, reason, refuted.actions
        )

    if not leaf.reaches_goal:
        return Verdict(leaf.actions, bool(leaf.feasible), "", leaf.violation)

    return Verdict(leaf.actions, bool(leaf.solved), "", leaf.violation, motion=motions.get(leaf))


def passes_check(scene: Scene, node: Node, path: NlpSolution) -> bool:
    """Say whether the independent check accepts a path.

    Args:
        scene: Scene of the path.
        node: Sequence of the path, with its NLP.
        path: Feasible solution of the path NLP.

    Returns:
        Whether the motion passes.
    """
    return check_motion(scene, node.actions, motion_of(scene, node, path)).passed


def motion_of(scene: Scene, node: Node, path: NlpSolution) -> Motion:
    """Return the motion of a path, at the rate of the check.

    Args:
        scene: Scene of the path.
        node: Sequence of the path, with its NLP.
        path: Solution of the path NLP.

    Returns:
        The motion of the whole scene.
    """
    assert node.problem is not None
    return interpolate(scene, node.problem, path.q, path.m)
