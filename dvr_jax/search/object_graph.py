"""All sequences of actions on one object alone, as a graph whose edges are windows (`dvr_jax.search.windows`).

A vertex is a symbolic state of the object together with its last two actions, and an edge is one more action. The graph
has at most a few hundred edges. A walk from the root of the graph is a chain of actions on the object. Refuted windows
close edges, so that the length of a shortest walk is a lower bound on the number of actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from dvr_jax.goals import OnRegion
from dvr_jax.logic import Action, Grounding, Task, ground_task
from dvr_jax.operators import Operator, is_duplicate
from dvr_jax.scene.start import end_conditions, symbolic_task
from dvr_jax.scene.types import Scene
from dvr_jax.search.windows import Window

UNREACHED = 1_000
"""Number of actions that stands for a goal that no walk reaches."""

Vertex = tuple[int, Window]
"""Symbolic state of the object in a world of its own, and the window of its last two actions."""


@dataclass(frozen=True, slots=True)
class Edge:
    """One action on the object after the actions of a vertex."""

    before: Vertex
    """Vertex before the action."""

    after: Vertex
    """Vertex after it."""

    action: Action
    """The action."""

    windows: tuple[Window, ...]
    """The windows of two and three actions that end with it, the shorter one first."""


class ObjectGraph:
    """The graph of one object of a scene."""

    def __init__(
        self,
        scene: Scene,
        name: str,
        operators: tuple[Operator, ...],
        is_possible: Callable[[Action], bool],
    ) -> None:
        """Enumerate all vertices and edges.

        Args:
            scene: A valid scene.
            name: Name of the object.
            operators: The operators that are known.
            is_possible: Function that returns whether the constants of the scene allow an action.
        """
        task = task_of_object(scene, name)
        grounding = ground_task(task, tuple(operator.pddl for operator in operators))
        allowed = {
            index: action
            for index, action in enumerate(grounding.actions)
            if is_possible(action) and not is_duplicate(scene, action, operators)
        }
        self.name = name
        """Name of the object."""

        self.root: Vertex = (grounding.initial_state, (None,))
        """The vertex before the first action."""

        self.goals: set[Vertex] = set()
        """Vertices at which all conditions of the goal on the object hold."""

        self._ends_at_goal = isinstance(scene.goal, OnRegion)

        self.edges_from: dict[Vertex, list[Edge]] = {}
        """Edges by the vertex before them, in order of their distance from the root."""

        self._enumerate(grounding, allowed)
        self.edges_to: dict[Vertex, list[Edge]] = {vertex: [] for vertex in self.edges_from}
        """Edges by the vertex after them."""
        for edge in self.edges:
            self.edges_to[edge.after].append(edge)

    def _enumerate(self, grounding: Grounding, allowed: dict[int, Action]) -> None:
        """Add all vertices and the edges between them, in order of their distance from the root.

        Args:
            grounding: The actions on the object alone.
            allowed: Those of them that are not impossible from the outset, by their numbers.
        """
        frontier: list[Vertex] = [self.root]
        while frontier:
            vertex = frontier.pop(0)
            if vertex in self.edges_from:
                continue
            state, _ = vertex
            self.edges_from[vertex] = []
            if grounding.is_goal(state):
                self.goals.add(vertex)
                # A goal of several facts may need further actions on the object, as another one may be in its way.
                if self._ends_at_goal:
                    continue
            for index in grounding.applicable(state):
                if index in allowed:
                    edge = _edge(vertex, grounding.successor(state, index), allowed[index])
                    self.edges_from[vertex].append(edge)
                    frontier.append(edge.after)

    @property
    def edges(self) -> Iterable[Edge]:
        """All edges."""
        return (edge for edges in self.edges_from.values() for edge in edges)

    def vertex_after(self, chain: Iterable[Action]) -> Vertex | None:
        """Return the vertex after actions on the object; None if a constant of the scene refutes one of them."""
        vertex = self.root
        for action in chain:
            for edge in self.edges_from[vertex]:
                if edge.action == action:
                    vertex = edge.after
                    break
            else:
                return None
        return vertex

    def distances_to_goal(
        self, is_open: Callable[[Edge], bool], last_arm: str | None = None
    ) -> dict[Vertex, int]:
        """Return the least number of actions from every vertex to the goal.

        Args:
            is_open: Function that returns whether an edge may be used.
            last_arm: Name of an argument (an arm) that the last action must have; None for any.

        Returns:
            The numbers of the vertices from which the goal can be reached.
        """
        distance = dict.fromkeys(self.goals, 0)

        def is_usable(edge: Edge) -> bool:
            """Return whether an edge leads from a vertex without a number by an action that is allowed."""
            is_last = edge.after in self.goals
            if is_last and last_arm is not None and last_arm not in edge.action.arguments:
                return False
            return edge.before not in distance and is_open(edge)

        frontier = list(self.goals)
        while frontier:
            edges = [edge for vertex in frontier for edge in self.edges_to[vertex]]
            frontier = []
            for edge in edges:
                if is_usable(edge):
                    distance[edge.before] = distance[edge.after] + 1
                    frontier.append(edge.before)
        return distance


def task_of_object(scene: Scene, name: str) -> Task:
    """Return the symbolic task of one object in a world of its own.

    Args:
        scene: A valid scene.
        name: Name of the object. For the paper's goal, any object counts as the goal's.
    """
    task = symbolic_task(scene)
    initial = tuple(fact for fact in task.initial if fact[1] == name)
    if isinstance(scene.goal, OnRegion):
        goal = (("on", name, scene.goal.region.name),)
        return replace(task, objects=(name,), goal=goal, initial=initial)

    conditions = [condition for condition in end_conditions(scene) if condition.item == name]
    return replace(
        task,
        objects=(name,),
        goal=tuple(condition.fact for condition in conditions if condition.holds),
        forbidden=tuple(condition.fact for condition in conditions if not condition.holds),
        initial=initial,
    )


def _edge(vertex: Vertex, state: int, action: Action) -> Edge:
    """Create the edge of one action from a vertex."""
    pair: Window = (vertex[1][-1], action)
    windows: tuple[Window, ...] = (pair,)
    if len(vertex[1]) == 2:
        windows = (pair, (*vertex[1], action))
    return Edge(vertex, (state, pair), action, windows)
