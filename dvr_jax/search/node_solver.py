"""The numerical work behind the bounds of one scene's tree: it samples beams and solves keyframe NLPs and path NLPs.

Methods that return `Steps` are generators: they yield requests for work (`dvr_jax.search.work`) and are sent the
results.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TypeVar

import numpy as np

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem, Variables, number_of_phases
from dvr_jax.nlp.transcription import transcribe, transcribe_switch
from dvr_jax.operators import Operator, operator_of
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.work import ExtendBeams, SolveNlps, Steps
from dvr_jax.seeds.beam_batches import BeamTask, adopt_solution
from dvr_jax.seeds.initial_paths import (
    initial_path,
    keyframe_start,
    optimal_path_problem,
    path_problem,
    window_path_problem,
)
from dvr_jax.seeds.keyframe_beam import (
    BEAM_WIDTH,
    CERTIFIED_PENETRATION,
    UNREACHABLE,
    KeyframeBeam,
    held_beam,
)
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import Settings
from dvr_jax.workcell.model import workcell_model

FURTHER_STARTS = (5, 10)
"""Ranks of the candidates that the keyframe NLP is started from if the start from the best one (rank 0) fails.

Candidates of neighboring ranks often are siblings, so two distant ranks are used. In 1,100 prefixes these two starts
found all but one of the solutions that all fifteen other candidates found.
"""

PATH_STARTS = 4
"""Largest number of keyframe solutions that the path NLP of a leaf is started from, one after the other."""

GOOD_PENETRATION = 0.01
"""Candidates whose penetrations sum up to at most this are good enough to start a path from [m]."""

BATCH = 64
"""Number of prefixes that are judged between two comparisons of the time with the deadline."""

LANES = 192
"""Number of keyframe NLPs that are solved between two comparisons of the time with the deadline."""

_Item = TypeVar("_Item")


class OutOfTime(Exception):
    """The tree's deadline has passed."""


@dataclass(slots=True)
class Counts:
    """Numbers of NLPs solved and of prefixes judged, by bound."""

    nlps: Counter[str] = field(default_factory=Counter)
    """Number of NLP solves for the bounds "window", "motion", "pose", "sequence" and "path", and for the "optimum";
    every start counts."""

    verdicts: Counter[str] = field(default_factory=Counter)
    """Number of prefixes judged by each bound, including those that a candidate proved feasible or a constant of the
    scene refuted. The key "leaf" counts the sequences that reach the goal and were considered."""

    feasible: Counter[str] = field(default_factory=Counter)
    """Number of prefixes that each bound judged to be feasible."""


class NodeSolver:
    """Samples the beams and solves the NLPs of the nodes of one scene, and counts both."""

    def __init__(
        self, scene: Scene, settings: Settings, deadline: float, operators: Sequence[Operator]
    ) -> None:
        """Prepare the work on one scene.

        Args:
            scene: A valid scene.
            settings: Settings of the solver.
            deadline: Time of `time.monotonic` after which `OutOfTime` is raised [s].
            operators: The operators that are known.
        """
        self.scene = scene
        self.settings = settings
        self.deadline = deadline
        self.operators = operators
        self.model = workcell_model(scene.workcell)
        self.counts = Counts()

    def look_at_the_clock(self) -> None:
        """Raise `OutOfTime` if the deadline has passed."""
        if time.monotonic() > self.deadline:
            raise OutOfTime

    def sample(
        self, nodes: list[Node], ignored: list[tuple[str, ...]], seed: int
    ) -> Steps[list[Node]]:
        """Sample the beams of nodes whose parents have beams, and mark nodes that a candidate proves feasible.

        Args:
            nodes: The nodes.
            ignored: For each node, names of the objects that are left out of the world.
            seed: Seed of the sample.

        Returns:
            Those nodes that no candidate proves feasible.
        """
        for first in range(0, len(nodes), BATCH):
            self.look_at_the_clock()
            part = nodes[first : first + BATCH]
            tasks = [
                self._beam_task(*task)
                for task in zip(part, ignored[first : first + BATCH], strict=True)
            ]
            beams = yield ExtendBeams(self.model, tasks, seed)
            for node, task, beam in zip(part, tasks, beams, strict=True):
                node.problem = task.problem
                node.beam = beam
                node.feasible = bool(beam.violation.min() <= CERTIFIED_PENETRATION)
        return [node for node in nodes if not node.feasible]

    def _beam_task(self, node: Node, ignored: tuple[str, ...]) -> BeamTask:
        """Collect what the beam of a node is sampled from: the parent's beam, the keyframe NLP and the proposal."""
        problem = node.problem or transcribe(self.scene, node.actions, ignored, self.operators)
        last = number_of_phases(problem) - 1
        before = ModeKind(int(problem.mode_kind[last, problem.switched_object[last]]))
        proposal = operator_of(node.actions[-1], self.operators).proposal(before)
        return BeamTask(self._parent_beam(node, ignored), problem, proposal)

    def _parent_beam(self, node: Node, ignored: tuple[str, ...]) -> KeyframeBeam:
        """Return the beam of a node's parent; the root's beam is adapted to the ignored objects."""
        assert node.parent is not None and node.parent.beam is not None
        if node.parent.depth == 0 and ignored:
            return self.leave_out(node.parent.beam, frozenset(ignored))
        return node.parent.beam

    def leave_out(self, beam: KeyframeBeam | None, ignored: frozenset[str]) -> KeyframeBeam:
        """Return a copy of a beam with some objects left out of the world.

        Args:
            beam: A beam with fewer objects left out.
            ignored: Names of the objects.
        """
        assert beam is not None
        kind = np.array(beam.kind)
        kind[[self.scene.object_index(name) for name in ignored]] = ModeKind.ABSENT
        return beam._replace(kind=kind)

    def solve(self, nodes: list[Node], bound: str) -> Steps[None]:
        """Solve the keyframe NLPs of nodes that no candidate proved feasible.

        Every NLP starts from the node's best candidate. Those that fail are started again from the candidates of the
        ranks `FURTHER_STARTS`. A node whose starts all fail is refuted. The verdicts do not depend on the order: if
        several nodes are few enough for one call of the solver, which takes as long for few slices as for many, all
        their starts are solved at once.

        Args:
            nodes: The nodes.
            bound: Name of the bound that the NLPs are counted for and that refutes nodes.
        """
        for group in _by_depth(nodes, attrgetter("depth")):
            # If inverse kinematics reached no proposal of the node, further starts do not help.
            reached = [node for node in group if _is_reached(node)]
            further = [(node, rank) for node in reached for rank in FURTHER_STARTS]
            lanes = [(node, 0) for node in group]
            slices = (len(lanes) + len(further)) * group[0].depth
            if len(group) > 1 and slices <= batch_sizes().chunk:
                yield from self._solve_from(lanes + further, bound, is_best_enough=True)
            else:
                yield from self._solve_from(lanes, bound)
                yield from self._solve_from(
                    [lane for lane in further if not lane[0].feasible], bound
                )
            for node in group:
                if not node.feasible:
                    node.refute(bound, node.violation)

    def _solve_from(
        self, lanes: Sequence[tuple[Node, int]], bound: str, is_best_enough: bool = False
    ) -> Steps[None]:
        """Solve keyframe NLPs of nodes of one depth.

        Args:
            lanes: For each NLP its node and the rank of the candidate that it is started from.
            bound: Name of the bound that the NLPs are counted for.
            is_best_enough: Whether the other solutions of a node are not used if its best candidate leads to one.
        """
        for first in range(0, len(lanes), LANES):
            self.look_at_the_clock()
            part = lanes[first : first + LANES]
            problems = [_problem_of(node) for node, _ in part]
            starts = [keyframe_start(_beam_of(node), rank, node.depth) for node, rank in part]
            solutions = yield SolveNlps(self.model, problems, starts, self.settings)
            self.counts.nlps[bound] += len(part)
            found = list(zip(part, solutions, strict=True))
            done = {lane[0] for lane, solution in found if lane[1] == 0 and solution.feasible}
            for (node, rank), solution in found:
                if is_best_enough and rank > 0 and node in done:
                    continue
                if solution.feasible:
                    node.feasible = True
                    node.beam = adopt_solution(_beam_of(node), _problem_of(node), solution)
                else:
                    # `min` returns its first argument if the second is NaN, the initial value of `node.violation`.
                    node.violation = min(solution.relative_violation, node.violation)
                    node.add_evidence(_problem_of(node), solution)

    def solve_from_all(self, nodes: list[Node], bound: str) -> Steps[None]:
        """Solve the keyframe NLPs of nodes, starting from every candidate of their beams.

        Args:
            nodes: The nodes.
            bound: Name of the bound that the NLPs are counted for.
        """
        for group in _by_depth(nodes, attrgetter("depth")):
            reached = [node for node in group if _is_reached(node)]
            lanes = [(node, rank) for node in reached for rank in range(BEAM_WIDTH)]
            yield from self._solve_from(lanes, bound)

    def isolate_switch(self, node: Node, root: Node, ignored: Sequence[str], seed: int) -> None:
        """Give a node of two actions on one object the keyframe NLP of the second action alone.

        The node also gets a parent whose beam holds random grasps of the object, within the bounds of the first action.

        Args:
            node: An action that leaves its object in a gripper, and the next action on the same object.
            root: The tree's root.
            ignored: Names of the objects that are left out.
            seed: Seed of the sample.
        """
        assert root.beam is not None
        before, action = node.actions
        k_max = root.beam.q.shape[1]
        node.problem = transcribe_switch(self.scene, before, action, ignored, self.operators)
        node.parent = Node((before,), 0, root, reaches_goal=False, feasible=True)
        node.parent.beam = held_beam(node.problem, k_max, seed)

    def path_keyframes(self, node: Node) -> list[Variables]:
        """Return keyframes that a path may start from: good candidates, at least one and at most `PATH_STARTS`.

        Args:
            node: A node that passed the sequence bound.
        """
        assert node.feasible
        beam = _beam_of(node)
        # The starts are spread over the good candidates, because neighbors in rank often are siblings.
        good = int((beam.violation <= GOOD_PENETRATION).sum())
        return [
            keyframe_start(beam, rank, node.depth) for rank in _spread(range(good), PATH_STARTS)
        ]

    def more_keyframes(self, node: Node, most: int) -> Steps[list[Variables]]:
        """Solve the keyframe NLP from candidates that penetrate too deeply to start a path from.

        Args:
            node: A node that passed the sequence bound.
            most: Largest number of solutions to return.

        Returns:
            At most `most` feasible solutions.
        """
        self.look_at_the_clock()
        problem = _problem_of(node)
        beam = _beam_of(node)
        good = int((beam.violation <= GOOD_PENETRATION).sum())
        ranks = range(good, int((beam.violation < UNREACHABLE).sum()))
        starts = [keyframe_start(beam, rank, node.depth) for rank in ranks]
        if not starts:
            return []
        solutions = yield SolveNlps(self.model, [problem] * len(starts), starts, self.settings)
        self.counts.nlps["sequence"] += len(starts)
        return _spread([Variables(found.q, found.m) for found in solutions if found.feasible], most)

    def solve_path(self, node: Node, keyframes: Variables | None = None) -> Steps[NlpSolution]:
        """Solve the path NLP of a node that passed the sequence bound.

        Args:
            node: The node.
            keyframes: Keyframes that the initial path interpolates; None for the best ones of the node's beam.
        """
        self.look_at_the_clock()
        problem = _problem_of(node)
        start = initial_path(self.model, problem, keyframes or self.path_keyframes(node)[0])
        self.counts.nlps["path"] += 1
        path = path_problem(problem, start)
        solved: list[NlpSolution] = yield SolveNlps(self.model, [path], [start], self.settings)
        if not solved[0].feasible:
            node.add_evidence(path, solved[0])
        return solved[0]

    def solve_window_paths(self, lanes: Sequence[tuple[Node, Node, Variables]]) -> Steps[None]:
        """Solve path NLPs of windows, and mark the nodes of those that have a motion.

        Args:
            lanes: For each NLP a node that gets the verdict, a node of the same actions whose keyframe NLP is
                feasible, and a solution of it.
        """
        for group in _by_depth(lanes, lambda lane: lane[0].depth):
            self.look_at_the_clock()
            tasks = [
                window_path_problem(self.model, _problem_of(node), keyframes)
                for _, node, keyframes in group
            ]
            problems = [problem for problem, _ in tasks]
            starts = [start for _, start in tasks]
            solutions = yield SolveNlps(self.model, problems, starts, self.settings)
            self.counts.nlps["motion"] += len(group)
            for (judged, _, _), problem, solution in zip(group, problems, solutions, strict=True):
                if solution.feasible:
                    judged.feasible = True
                else:
                    judged.violation = min(solution.relative_violation, judged.violation)
                    judged.add_evidence(problem, solution)

    def optimize_path(self, node: Node, path: NlpSolution) -> Steps[NlpSolution]:
        """Solve the path NLP without the pull to its start, from a feasible path to an optimal one.

        Args:
            node: The node.
            path: A feasible path of it.

        Returns:
            The optimal path; the feasible one if the deadline has passed or no better one was found.
        """
        if time.monotonic() > self.deadline:
            return path
        start = Variables(path.q, path.m)
        problem = optimal_path_problem(_problem_of(node), start)
        self.counts.nlps["optimum"] += 1
        solved: list[NlpSolution] = yield SolveNlps(
            self.model, [problem], [start], SequentialSettings()
        )
        return solved[0] if solved[0].feasible else path


def _problem_of(node: Node) -> Problem:
    assert node.problem is not None
    return node.problem


def _beam_of(node: Node) -> KeyframeBeam:
    assert node.beam is not None
    return node.beam


def _spread(items: Sequence[_Item], most: int) -> list[_Item]:
    """Return at most `most` of the items: the first one and others at equal distances in the list."""
    count = min(most, len(items))
    return [items[i * (len(items) // count)] for i in range(count)]


def _by_depth(items: Sequence[_Item], depth: Callable[[_Item], int]) -> list[list[_Item]]:
    """Divide items into groups of equal depth, whose NLPs have the same shape and can share a batch."""
    groups: dict[int, list[_Item]] = {}
    for item in items:
        groups.setdefault(depth(item), []).append(item)
    return list(groups.values())


def _is_reached(node: Node) -> bool:
    """Return whether inverse kinematics found postures for all switches of at least one candidate."""
    return node.beam is not None and bool(node.beam.violation.min() < UNREACHABLE)
