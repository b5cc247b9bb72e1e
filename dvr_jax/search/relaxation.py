"""The relaxation of a whole scene: a lower bound on the number of actions, which often shows that there is no solution.

For each object there is a graph of all sequences of actions on it alone (`dvr_jax.search.object_graph`). Its edges are
windows of two or three actions that are judged with all other movable objects left out. A window is judged only when it
lies on a shortest way to the goal, and its verdict is shared by all sequences that contain it.

The bound on the number of actions has two parts. The goal's object needs at least d actions, the length of a shortest
walk in its graph. Another object *blocks* if the walk is longer, or if there is none, while it stands where the scene
has it. In each solution an object either stays, and then the walk is as long as it is with this object standing, or it
is moved, and then two more actions are needed: it is grasped, and it leaves the gripper again. One action suffices for
as many objects as there are arms that do not carry out the last action, because these may hold an object at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import Operator, Parameter, object_of, operator_of
from dvr_jax.scene.stacks import objects_above
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.object_graph import UNREACHED, Vertex
from dvr_jax.search.obstruction import obstructions
from dvr_jax.search.walks import Walks
from dvr_jax.search.windows import Ignored, Window, WindowBound, last_windows
from dvr_jax.search.work import Steps

MOVE = 2
"""Number of actions that move an object out of the way: it is grasped, and leaves the gripper again."""


class Relaxation:
    """Lower bounds on the number of actions of one scene and of its prefixes."""

    def __init__(
        self,
        solver: NodeSolver,
        root: Node,
        seed: int,
        is_possible: Callable[[Action], bool],
    ) -> None:
        """Create a relaxation that has no verdict yet.

        Args:
            solver: Numerical work on the scene.
            root: The tree's root.
            seed: Seed of all sampling.
            is_possible: Function that returns whether the constants of the scene allow an action.
        """
        self.solver = solver
        self.windows = WindowBound(solver, root, seed)
        self.walks = Walks(solver.scene, self.windows, tuple(solver.operators), is_possible)
        self.blocking: dict[str, int] = {}
        """Least number of actions on the goal's object while an object stands where the scene has it, by its name."""

        self.alone = 0
        """Least number of actions on the goal's object if it is alone in the world."""

        self.lower_bound = 0
        """Least number of actions of a solution, as far as it is known; `UNREACHED` if there is none."""

        self.is_computed = False
        """Whether `compute` has ended, so that the bound is final for its limit."""

        self._operators: Sequence[Operator] = solver.operators
        self._limit = -1
        self._remaining: dict[str | None, dict[Vertex, int]] = {}
        self.required: frozenset[str] = frozenset()
        """Names of the objects that have to be moved."""

        self._obstructions: dict[tuple[str, str], dict[str, float]] = {}
        self._vertices: dict[tuple[Action, ...], Vertex | None] = {}

    @property
    def goal_object(self) -> str:
        """Name of the object of the paper's goal."""
        return self.solver.scene.paper_goal.object

    def compute(self, limit: int) -> Steps[int]:
        """Compute the lower bound of the scene.

        Args:
            limit: Number of actions above which the exact value of the bound does not matter.

        Returns:
            The bound, which is also stored.
        """
        if self._limit >= limit:
            return self.lower_bound
        self._limit = limit
        self.is_computed = False
        name = self.goal_object
        alone = yield from self.walks.shortest(name, (self.walks.others(name),), limit)
        self.alone = alone
        self.lower_bound = alone
        if alone > limit:
            self.is_computed = True
            return alone

        for other in sorted(self.walks.others(name)):
            region = self.solver.scene.paper_goal.region.name
            stands_on_it = other in objects_above(self.solver.scene, name)
            if stands_on_it or other in self._obstructions_of(name, region):
                self.blocking[other] = UNREACHED
                continue
            worlds = (self.walks.others(name), self.walks.others(name, other))
            self.blocking[other] = yield from self.walks.shortest(name, worlds, limit)
        yield from self._judge_first_grasps(
            [o for o, least in self.blocking.items() if least > alone]
        )

        self._remaining.clear()
        self.lower_bound = min(map(self._bound_of_scene, sorted({alone, *self.blocking.values()})))
        self.required = frozenset(o for o, least in self.blocking.items() if least > limit)
        self.is_computed = True
        return self.lower_bound

    def _bound_of_scene(self, length: int) -> int:
        """Return a lower bound for the solutions in which an object stays only if it allows a walk of some length.

        Args:
            length: The length; objects with which the walk is longer are moved, and the walk is at least as long as
                the longest that an object that stays demands.
        """
        moved = [other for other, least in self.blocking.items() if least > length]
        root = self.walks.graph(self.goal_object).root
        return min(
            max(length, self._distances(arm).get(root, UNREACHED))
            + self._moving_cost_for(moved, arm)
            for arm in self.solver.scene.workcell.arm_names
        )

    def judge_windows(self, nodes: Sequence[Node], least: int = 1) -> Steps[list[bool]]:
        """Judge the last two actions on one object of each node, and refute the nodes that fail.

        Args:
            nodes: The nodes.
            least: Number of actions on the object from which on windows are judged. Verdicts that are known are used
                for all nodes.

        Returns:
            Whether each of them passes.
        """
        wanted: dict[Ignored, list[Window]] = {}
        for node in nodes:
            if node.feasible is None:
                name = object_of(node.actions[-1], self._operators)
                number = sum(object_of(a, self._operators) == name for a in node.actions)
                if number < least:
                    continue
                pair, _ = last_windows(node.actions, self._operators)
                wanted.setdefault(self.walks.others(name), []).append(pair)
        for ignored, windows in wanted.items():
            yield from self.windows.judge(windows, ignored)
        self._remaining.clear()
        return [self.check_cached(node) for node in nodes]

    def check_cached(self, node: Node) -> bool:
        """Return False and refute the node if a window that it ends with is known to be infeasible."""
        if node.feasible is False:
            return False
        window = self.refuting_window(node.actions)
        others = self.walks.others(object_of(node.actions[-1], self._operators))
        if window is not None and self.windows.is_motion_refuted(window, others):
            judged = self.windows.node(window, others)
            assert judged is not None
            node.refute("path", judged.violation, judged)
            return False

        # A node whose keyframes are known is feasible: a bound on keyframes, which may miss some, must not refute it.
        if node.feasible:
            return True
        if self.obstruction(node.actions) is not None:
            node.refute("pose", math.nan)
            return False
        if window is None:
            return True
        judged = self.windows.node(window, others)
        node.refute("pose", math.nan if judged is None else judged.violation, judged)
        return False

    def judge_motions(self, leaf: Node) -> Steps[None]:
        """Judge the motions of all windows of a leaf whose path has failed.

        If one of them is refuted, the lower bound of the scene is computed anew when it is needed next.

        Args:
            leaf: The leaf.
        """
        wanted: dict[Ignored, list[Window]] = {}
        for depth in range(1, leaf.depth + 1):
            window, _ = last_windows(leaf.actions[:depth], self._operators)
            name = object_of(leaf.actions[depth - 1], self._operators)
            wanted.setdefault(self.walks.others(name), []).append(window)

        number = self.windows.motions.number_refuted
        for ignored, windows in wanted.items():
            yield from self.windows.judge(windows, ignored)
            yield from self.windows.judge_motions(windows, ignored)
        if self.windows.motions.number_refuted > number:
            self._limit = -1
            self._remaining.clear()

    def is_motion_refuted(self, leaf: Node) -> bool:
        """Return whether a window of a leaf is known to have no motion, and refute the leaf then."""
        prefixes = [leaf.ancestor(depth) for depth in range(1, leaf.depth + 1)]
        return not all([self.check_cached(prefix) for prefix in prefixes])

    def obstruction(self, actions: Sequence[Action]) -> str | None:
        """Return the name of an object that stands where the last action places another one; None if there is none."""
        last = actions[-1]
        if last.arguments[-1] not in self.solver.scene.region_names:
            return None
        overlaps = self._obstructions_of(object_of(last, self._operators), last.arguments[-1])
        moved = {object_of(action, self._operators) for action in actions} if overlaps else set()
        return next((other for other in sorted(overlaps) if other not in moved), None)

    def _obstructions_of(self, name: str, region: str) -> dict[str, float]:
        """Return the objects that exclude all placements of an object on a region, while they stand."""
        if (name, region) not in self._obstructions:
            self._obstructions[name, region] = obstructions(self.solver.scene, name, region)
        return self._obstructions[name, region]

    def refuting_window(self, actions: Sequence[Action]) -> Window | None:
        """Return a window that a sequence ends with and that is known to be infeasible, or None."""
        name = object_of(actions[-1], self._operators)
        for window in last_windows(actions, self._operators):
            if (
                window is not None
                and self.windows.verdict(window, self.walks.others(name)) is False
            ):
                return window
        return None

    def remaining(self, actions: Sequence[Action]) -> int:
        """Return a lower bound on the number of actions after a prefix, from the verdicts that are known.

        Args:
            actions: The prefix, which does not reach the goal.
        """
        if self._limit < 0:
            return 0
        objects = [object_of(action, self._operators) for action in actions]
        chain = tuple(
            action
            for action, name in zip(actions, objects, strict=True)
            if name == self.goal_object
        )
        if chain not in self._vertices:
            self._vertices[chain] = self.walks.graph(self.goal_object).vertex_after(chain)
        vertex = self._vertices[chain]
        if vertex is None:
            return UNREACHED
        moved = set(objects)
        blocking = [other for other in sorted(self.required) if other not in moved]
        if not blocking:
            return self._distances(None).get(vertex, UNREACHED)
        return min(
            self._distances(arm).get(vertex, UNREACHED) + self._moving_cost_for(blocking, arm)
            for arm in self.solver.scene.workcell.arm_names
        )

    def is_hopeless(self) -> bool:
        """Return whether no number of actions suffices, as far as windows are known."""
        return bool(self.immovable()) or self.least_without_limit() >= UNREACHED

    def immovable(self) -> list[str]:
        """Return the names of the objects that have to be moved and that no arm can grasp."""
        return [name for name in self.required if self._moving_cost([name]) >= UNREACHED]

    def least_without_limit(self) -> int:
        """Return the lower bound for any limit, from the verdicts that are known."""
        graph = self.walks.graph(self.goal_object)
        distance = graph.distances_to_goal(self.walks.is_open(self.goal_object))
        alone = distance.get(graph.root, UNREACHED)
        return min(max(alone, self.remaining(())), UNREACHED)

    def _distances(self, arm: str | None) -> dict[Vertex, int]:
        """Return the distances to the goal in the graph of the goal's object, for a given last arm."""
        if arm not in self._remaining:
            is_open = self.walks.is_open(self.goal_object)
            self._remaining[arm] = self.walks.graph(self.goal_object).distances_to_goal(
                is_open, arm
            )
        return self._remaining[arm]

    def _judge_first_grasps(self, names: Sequence[str]) -> Steps[None]:
        """Judge the first actions on these objects."""
        for name in names:
            graph = self.walks.graph(name)
            first = [edge.windows[0] for edge in graph.edges_from[graph.root]]
            yield from self.windows.judge(first, self.walks.others(name))

    def _moving_cost(self, names: Sequence[str]) -> int:
        """Return the least number of actions that move these objects, whichever arm carries out the last action."""
        return min(
            self._moving_cost_for(names, arm) for arm in self.solver.scene.workcell.arm_names
        )

    def _moving_cost_for(self, names: Sequence[str], last_arm: str) -> int:
        """Return the least number of actions that move these objects if an arm carries out the last action."""
        cost = 0
        can_be_held = 0
        for name in names:
            graph = self.walks.graph(name)
            is_open = self.walks.is_open(name)
            first = [edge.action for edge in graph.edges_from[graph.root] if is_open(edge)]
            if not first:
                return UNREACHED
            grasps = [action for action in first if self._is_grasp(action)]
            cost += MOVE if len(grasps) == len(first) else MOVE - 1
            can_be_held += any(
                self._arm_of(action) != last_arm for action in grasps if len(grasps) == len(first)
            )
        free_arms = self.solver.scene.workcell.number_of_arms - 1
        return cost - min(can_be_held, free_arms)

    def _is_grasp(self, action: Action) -> bool:
        """Return whether an action leaves its object in a gripper."""
        return operator_of(action, self._operators).mode_after == ModeKind.HELD

    def _arm_of(self, action: Action) -> str:
        """Return the name of the arm that carries an action out."""
        return operator_of(action, self._operators).argument(action, Parameter.ARM)
