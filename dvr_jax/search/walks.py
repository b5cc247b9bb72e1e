"""Shortest walks through the graphs of single objects, along windows that are judged only where they are needed.

A walk is a chain of actions on one object (`dvr_jax.search.object_graph`). All windows count as feasible until they are
judged. The windows on the shortest walks are judged, the refuted ones close their edges, and this is repeated until the
windows of a shortest walk are all feasible. No walk that is possible is shorter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dvr_jax.logic import Action
from dvr_jax.operators import Operator
from dvr_jax.scene.types import Scene
from dvr_jax.search.object_graph import UNREACHED, Edge, ObjectGraph, Vertex
from dvr_jax.search.windows import Ignored, Window, WindowBound
from dvr_jax.search.work import Steps


class Walks:
    """Graphs of the objects of one scene, and shortest walks through them."""

    def __init__(
        self,
        scene: Scene,
        windows: WindowBound,
        operators: tuple[Operator, ...],
        is_possible: Callable[[Action], bool],
    ) -> None:
        """Begin without any graph.

        Args:
            scene: A valid scene.
            windows: Verdicts on windows.
            operators: The operators that are known.
            is_possible: Function that returns whether the constants of the scene allow an action.
        """
        self._scene = scene
        self._windows = windows
        self._operators = operators
        self._is_possible = is_possible
        self._graphs: dict[str, ObjectGraph] = {}

    def graph(self, name: str) -> ObjectGraph:
        """Return the graph of an object."""
        if name not in self._graphs:
            self._graphs[name] = ObjectGraph(self._scene, name, self._operators, self._is_possible)
        return self._graphs[name]

    def others(self, *names: str) -> Ignored:
        """Return the names of all objects but these."""
        return frozenset(self._scene.object_names) - set(names)

    def is_open(self, name: str) -> Callable[[Edge], bool]:
        """Return a function that says whether no window of an edge is refuted in a world without other objects."""
        return self.open_edges(name, (self.others(name),))

    def open_edges(self, name: str, worlds: Sequence[Ignored]) -> Callable[[Edge], bool]:
        """Return a function that says whether no window of an edge is refuted in any of these worlds."""

        def is_open(edge: Edge) -> bool:
            return all(
                self._windows.verdict(window, ignored) is not False
                for window in edge.windows
                for ignored in worlds
            )

        return is_open

    def shortest(self, name: str, worlds: Sequence[Ignored], limit: int) -> Steps[int]:
        """Return the length of a shortest walk to the goal whose windows are feasible in all these worlds.

        Only windows on shortest walks are judged. The last world has most objects, and what is refuted in one of the
        others, which have fewer objects, is refuted there too.

        Args:
            name: Name of the object.
            worlds: Names of the objects that are left out, for each world.
            limit: Length above which the exact value does not matter.

        Returns:
            The length; `UNREACHED` if it is above the limit.
        """
        graph = self.graph(name)
        world = worlds[-1]
        while True:
            distance = graph.distances_to_goal(self.open_edges(name, worlds))
            length = distance.get(graph.root, UNREACHED)
            if length > limit:
                return UNREACHED
            unknown = self._unknown_windows(graph, distance, worlds)
            if not unknown:
                return length
            yield from self._windows.judge(unknown, world)

    def _unknown_windows(
        self, graph: ObjectGraph, distance: dict[Vertex, int], worlds: Sequence[Ignored]
    ) -> list[Window]:
        """Return the windows to be judged next: the first unknown ones on the shortest walks.

        Returns:
            Nothing if the windows of a shortest walk are all feasible. Those of two actions come before those of three.
        """
        is_open = self.open_edges(graph.name, worlds)
        world = worlds[-1]
        for part in (1, 2):
            unknown: dict[Window, None] = {}
            level = {graph.root}
            while level and not level & graph.goals:
                edges = [
                    edge
                    for vertex in level
                    for edge in graph.edges_from[vertex]
                    if distance.get(edge.after, UNREACHED) < distance[vertex] and is_open(edge)
                ]
                level = set()
                for edge in edges:
                    windows = edge.windows[:part]
                    first = [w for w in windows if self._windows.verdict(w, world) is None][:1]
                    unknown.update(dict.fromkeys(first))
                    if not first:
                        level.add(edge.after)
            if not level:
                return list(unknown)
        return []
