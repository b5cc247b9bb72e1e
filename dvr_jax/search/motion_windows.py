"""Motion windows: verdicts on the motion of the last action of a window, with all other movable objects left out.

Keyframes may exist for an action, but no motion: the hand has to come straight to an object, and a held object is
lifted and lowered, for which an arm close to its limits has no room. Such an action costs much time, because the path
NLP of each sequence that contains it is solved in vain. A *motion window* is a window of two actions (or of the first
action on an object) whose path NLP is solved instead (`dvr_jax.seeds.initial_paths.window_path_problem`). Its verdict
is shared by all sequences that contain it.

Motion windows are examined only after the path of a sequence has failed: first those of this sequence. If one of them
is refuted, those on shortest walks follow (`dvr_jax.search.walks`). A motion window is refuted only after the starts
from `MOTION_SAMPLES` samples of keyframes have failed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.work import Steps

MOTION_SAMPLES = 2
"""Number of samples (seeds) of keyframes from which all starts have to fail before a motion window is refuted."""

Sampler = Callable[[Sequence[Node], int], Steps[list[Node]]]
"""Function that judges the keyframes of windows once more, with another seed."""


class MotionWindows:
    """Computes the verdicts on motion windows of one scene and stores them."""

    def __init__(self, solver: NodeSolver, seed: int) -> None:
        """Begin without any verdict.

        Args:
            solver: Numerical work on the scene.
            seed: Seed of the first sample.
        """
        self._solver = solver
        self._seed = seed
        self._judged: dict[Node, Node] = {}
        self.number_refuted = 0
        """Number of motion windows that were refuted."""

    @property
    def has_refuted(self) -> bool:
        """Whether a motion window was refuted, so that those on shortest walks are worth their time."""
        return self.number_refuted > 0

    def node(self, window: Node) -> Node | None:
        """Return the node that holds the verdict on a window's motion and its evidence; None if it is not known.

        Args:
            window: Node of the window, with feasible keyframes.
        """
        return self._judged.get(window)

    def verdict(self, window: Node) -> bool | None:
        """Return whether a window with feasible keyframes has a motion; None if that is not known.

        Args:
            window: Node of the window, with feasible keyframes.
        """
        judged = self._judged.get(window)
        return None if judged is None else judged.feasible

    def judge(self, windows: Sequence[Node], sample: Sampler) -> Steps[None]:
        """Judge the motions of windows whose verdict is not known.

        Args:
            windows: Nodes of windows of one or two actions, all with feasible keyframes.
            sample: Function that samples the keyframes of some of them again.
        """
        unknown = [window for window in windows if window not in self._judged]
        for window in unknown:
            self._judged[window] = Node(
                window.actions, 0, window.parent, reaches_goal=False, problem=window.problem
            )

        yield from self._try_starts([(window, window) for window in unknown])
        for seed in range(self._seed + 1, self._seed + MOTION_SAMPLES):
            failed = [window for window in unknown if not self._judged[window].feasible]
            again = yield from sample(failed, seed)
            pairs = zip(failed, again, strict=True)
            yield from self._try_starts([(old, new) for old, new in pairs if new.feasible])

        for window in unknown:
            judged = self._judged[window]
            if not judged.feasible:
                judged.refute("path", judged.violation)
                self.number_refuted += 1
        counts = self._solver.counts
        counts.verdicts["motion"] += len(unknown)
        counts.feasible["motion"] += sum(bool(self._judged[window].feasible) for window in unknown)

    def _try_starts(self, windows: Sequence[tuple[Node, Node]]) -> Steps[None]:
        """Solve path NLPs of windows from the best keyframes, and those that fail from all others.

        Args:
            windows: Nodes of windows, each with a node of the same actions whose keyframes are used.
        """
        starts = [(old, new, self._solver.path_keyframes(new)) for old, new in windows]
        for ranks in (slice(0, 1), slice(1, None)):
            lanes = [
                (self._judged[old], new, keyframes)
                for old, new, found in starts
                if not self._judged[old].feasible
                for keyframes in found[ranks]
            ]
            yield from self._solver.solve_window_paths(lanes)
