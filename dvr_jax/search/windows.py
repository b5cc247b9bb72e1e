"""Windows: verdicts on two or three consecutive actions on one object, with all other movable objects left out.

A *window* is a tuple of actions that follow each other on one object. If it begins with None, its first action takes
the object from where the scene has it. Otherwise its first action is over when the window begins, and the object is
held in any way that this action allows. Few windows make up all sequences: an object of two arms and four faces has
about one hundred, but thousands of sequences of six actions. A refuted window refutes every sequence that contains it,
whatever happens to the other objects.

A window that is missed by sampling would refute solvable scenes. It is therefore refuted only after `WINDOW_SAMPLES`
samples with different seeds have failed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import transcribe_window
from dvr_jax.operators import Operator, object_of, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.reach import missing_reach
from dvr_jax.search.work import Steps
from dvr_jax.seeds.keyframe_beam import held_beam

WINDOW_SAMPLES = 2
"""Number of samples (seeds) that have to fail before a window is refuted."""

Window = tuple[Action | None, ...]
"""Two or three actions; None in the first place stands for the start of the scene."""

Ignored = frozenset[str]
"""Names of the objects that are left out of the world."""


def last_windows(
    actions: Sequence[Action], operators: Sequence[Operator], name: str | None = None
) -> tuple[Window, Window | None]:
    """Return the windows of two and of three actions that a sequence ends with.

    Args:
        actions: At least one action.
        operators: The operators that are known.
        name: Object of the windows; None for that of the last action.

    Returns:
        The last two actions on the object, and the last three; None where no window of three ends there.
    """
    item = name or object_of(actions[-1], operators)
    chain: list[Action | None] = [None]
    chain += [action for action in actions if object_of(action, operators) == item]
    return tuple(chain[-2:]), tuple(chain[-3:]) if len(chain) >= 3 else None


class WindowBound:
    """Computes the verdicts on windows of one scene and stores them."""

    def __init__(self, solver: NodeSolver, root: Node, seed: int) -> None:
        """Create a bound that has no verdict yet.

        Args:
            solver: Numerical work on the scene.
            root: The tree's root.
            seed: Seed of all sampling.
        """
        self._solver = solver
        self._root = root
        self._seed = seed
        self._nodes: dict[tuple[Window, Ignored], Node] = {}

    def verdict(self, window: Window, ignored: Ignored) -> bool | None:
        """Return whether a window is feasible; None if that is not known yet.

        Args:
            window: The window.
            ignored: Names of the objects that are left out.
        """
        if not self._is_judged(window):
            return True
        node = self._nodes.get((window, ignored))
        if node is not None and node.feasible is not None:
            return node.feasible
        return False if self._is_out_of_reach(window) else None

    def node(self, window: Window, ignored: Ignored) -> Node | None:
        """Return the node of a window, which holds its problem and its candidates; None if it was not examined."""
        return self._nodes.get((window, ignored))

    def judge(self, windows: Iterable[Window], ignored: Ignored) -> Steps[None]:
        """Judge windows whose verdict is not known.

        Args:
            windows: The windows.
            ignored: Names of the objects that are left out.
        """
        unknown = [
            window for window in dict.fromkeys(windows) if self.verdict(window, ignored) is None
        ]
        for seed in range(self._seed, self._seed + WINDOW_SAMPLES):
            remaining = [w for w in unknown if self.verdict(w, ignored) is not True]
            yield from self._sample(remaining, ignored, seed)
        counts = self._solver.counts
        counts.verdicts["window"] += len(unknown)
        counts.feasible["window"] += sum(bool(self.verdict(w, ignored)) for w in unknown)

    def _sample(self, windows: list[Window], ignored: Ignored, seed: int) -> Steps[None]:
        """Judge windows by one sample each."""
        left_out = tuple(sorted(ignored))
        nodes = [self._fresh_node(window, left_out, seed) for window in windows]

        # The beams of the windows without their last actions are sampled first, all those of one length together.
        parents = [
            node.parent for node in nodes if node.parent is not None and node.parent.beam is None
        ]
        assert all(parent.problem is not None or parent.depth == 1 for parent in parents)
        yield from self._solver.sample(parents, [left_out] * len(parents), seed)
        unproved = yield from self._solver.sample(nodes, [left_out] * len(nodes), seed)
        yield from self._solver.solve(unproved, "window")
        for window, node in zip(windows, nodes, strict=True):
            self._nodes[window, ignored] = node

    def _fresh_node(self, window: Window, ignored: tuple[str, ...], seed: int) -> Node:
        """Create the node of a window, with the nodes of its shorter parts as its ancestors."""
        actions = tuple(action for action in window if action is not None)
        if window[0] is None:
            node = self._root
            for length in range(1, len(actions) + 1):
                node = Node(actions[:length], 0, node, reaches_goal=False)
            return node

        before = actions[0]
        scene = self._solver.scene
        operators = self._solver.operators
        assert self._root.beam is not None
        node = Node((before,), 0, self._root, reaches_goal=False, feasible=True)
        for length in range(2, len(actions) + 1):
            problem = transcribe_window(scene, before, actions[1:length], ignored, operators)
            if length == 2:
                node.beam = held_beam(problem, self._root.beam.q.shape[1], seed)
            node = Node(actions[:length], 0, node, reaches_goal=False)
            node.problem = problem
        return node

    def _is_judged(self, window: Window) -> bool:
        """Return whether a window is judged at all. If the object may stand anywhere, almost everything is possible."""
        first = window[0]
        if first is None:
            return True
        return operator_of(first, self._solver.operators).mode_after == ModeKind.HELD

    def _is_out_of_reach(self, window: Window) -> bool:
        """Return whether a necessary condition that costs nothing refutes a window."""
        return missing_reach(self._solver.scene, window, self._solver.operators) > 0
