"""Windows: verdicts on two or three consecutive actions on one object, with all other movable objects left out.

A *window* is a tuple of actions that follow each other on one object. If it begins with None, its first action takes
the object from where the scene has it. Otherwise its first action is over when the window begins, and the object is
held in any way that this action allows. Few windows make up all sequences: an object of two arms and four faces has
about one hundred, but thousands of sequences of six actions. A refuted window refutes every sequence that contains it,
whatever happens to the other objects.

A window that is missed by sampling would refute solvable scenes. It is therefore refuted only after `WINDOW_SAMPLES`
samples with different seeds have failed. A window whose keyframes are feasible may have no motion
(`dvr_jax.search.motion_windows`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import transcribe_window
from dvr_jax.operators import Operator, lower_object_of, object_of, operator_of
from dvr_jax.search.motion_windows import MotionWindows
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
        self._out_of_reach: dict[Window, bool] = {}
        self.motions = MotionWindows(solver, seed)
        """Verdicts on the motions of windows."""

    def verdict(self, window: Window, ignored: Ignored) -> bool | None:
        """Return whether a window is feasible; None if that is not known yet.

        Args:
            window: The window.
            ignored: Names of the objects that are left out.
        """
        if not self._is_judged(window):
            return True
        node = self._nodes.get((window, ignored))
        if node is None or node.feasible is None:
            return False if self._is_out_of_reach(window) else None
        if not node.feasible or not _has_motion_window(window):
            return node.feasible
        has_motion = self.motions.verdict(node)
        # As long as all motions that were judged exist, keyframes suffice.
        return True if has_motion is None and not self.motions.has_refuted else has_motion

    def is_motion_refuted(self, window: Window, ignored: Ignored) -> bool:
        """Return whether a window is known to have keyframes, but no motion.

        Args:
            window: The window.
            ignored: Names of the objects that are left out.
        """
        node = self._nodes.get((window, ignored))
        return node is not None and self.motions.verdict(node) is False

    def node(self, window: Window, ignored: Ignored) -> Node | None:
        """Return the node whose NLPs decided on a window; None if it was not examined.

        Args:
            window: The window.
            ignored: Names of the objects that are left out.
        """
        node = self._nodes.get((window, ignored))
        return self.motions.node(node) or node if node is not None else None

    def judge(self, windows: Iterable[Window], ignored: Ignored) -> Steps[None]:
        """Judge windows whose verdict is not known.

        Args:
            windows: The windows.
            ignored: Names of the objects that are left out.
        """
        unknown = [
            window for window in dict.fromkeys(windows) if self.verdict(window, ignored) is None
        ]
        yield from self._judge_keyframes(unknown, ignored)
        if self.motions.has_refuted:
            yield from self.judge_motions(unknown, ignored)

    def _judge_keyframes(self, windows: Sequence[Window], ignored: Ignored) -> Steps[None]:
        """Judge the keyframes of windows that were not examined yet."""
        unknown = [window for window in windows if (window, ignored) not in self._nodes]
        samples: dict[Window, list[Node]] = {window: [] for window in unknown}

        # All samples are drawn before the NLPs are solved, because one call of the solver has room for many.
        remaining = unknown
        for seed in range(self._seed, self._seed + WINDOW_SAMPLES):
            nodes = yield from self._sample(remaining, ignored, seed)
            for window, node in zip(remaining, nodes, strict=True):
                samples[window].append(node)
            remaining = [window for window in remaining if not samples[window][-1].feasible]
        unproved = [node for window in remaining for node in samples[window]]
        yield from self._solver.solve(unproved, "window")

        for window, nodes in samples.items():
            self._nodes[window, ignored] = min(nodes, key=_rank)
        counts = self._solver.counts
        counts.verdicts["window"] += len(unknown)
        counts.feasible["window"] += sum(self._has_keyframes(w, ignored) for w in unknown)

    def judge_motions(self, windows: Iterable[Window], ignored: Ignored) -> Steps[None]:
        """Judge the motions of windows that have keyframes; those whose keyframes are not known are left out.

        Args:
            windows: The windows.
            ignored: Names of the objects that are left out.
        """
        window_of = {
            self._nodes[window, ignored]: window
            for window in windows
            if _has_motion_window(window) and self._has_keyframes(window, ignored)
        }

        def sample(nodes: Sequence[Node], seed: int) -> Steps[list[Node]]:
            """Judge the keyframes of some of the windows with another seed."""
            again = yield from self._sample([window_of[node] for node in nodes], ignored, seed)
            yield from self._solver.solve([node for node in again if not node.feasible], "window")
            return again

        yield from self.motions.judge(list(window_of), sample)

    def _has_keyframes(self, window: Window, ignored: Ignored) -> bool:
        """Return whether a window is known to have feasible keyframes."""
        node = self._nodes.get((window, ignored))
        return node is not None and bool(node.feasible)

    def _sample(self, windows: Sequence[Window], ignored: Ignored, seed: int) -> Steps[list[Node]]:
        """Sample candidates of windows, and return new nodes, of which those that a candidate proves are feasible."""
        left_out = tuple(sorted(ignored))
        nodes = [self._fresh_node(window, left_out, seed) for window in windows]

        # The beams of the windows without their last actions are sampled first, all those of one length together.
        parents = [
            node.parent for node in nodes if node.parent is not None and node.parent.beam is None
        ]
        assert all(parent.problem is not None or parent.depth == 1 for parent in parents)
        yield from self._solver.sample(parents, [left_out] * len(parents), seed)
        yield from self._solver.sample(nodes, [left_out] * len(nodes), seed)
        return nodes

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
        """Return whether a window is judged at all. If the object may stand anywhere, almost everything is possible.

        This is also so if it is put on another object, which is left out and may stand anywhere.
        """
        scene = self._solver.scene
        operators = self._solver.operators
        if any(a is not None and lower_object_of(scene, a, operators) for a in window):
            return False
        first = window[0]
        if first is None:
            return True
        return operator_of(first, self._solver.operators).mode_after == ModeKind.HELD

    def _is_out_of_reach(self, window: Window) -> bool:
        """Return whether a necessary condition that costs nothing refutes a window."""
        if window not in self._out_of_reach:
            missing = missing_reach(self._solver.scene, window, self._solver.operators)
            self._out_of_reach[window] = missing > 0
        return self._out_of_reach[window]


def _rank(node: Node) -> tuple[bool, float]:
    """Return a key that is least for a feasible node, or else for the one of least violation."""
    return not node.feasible, math.inf if math.isnan(node.violation) else node.violation


def _has_motion_window(window: Window) -> bool:
    """Return whether a window is one whose motion is judged: of two actions on the object, or of its first one."""
    return len(window) == 2
