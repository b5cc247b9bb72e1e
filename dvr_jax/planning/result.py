"""`Plan`: the result of planning one scene, with everything that is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Self

import numpy as np

from dvr_jax.checker import CheckReport
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.operators import OPERATORS, Operator, describe
from dvr_jax.planning.path_quality import PathQuality
from dvr_jax.scene.types import Scene
from dvr_jax.search.explanation import Refutation
from dvr_jax.search.reasons import Reason
from dvr_jax.search.status import PlanStatus


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Plan:
    """The result of planning one scene: how the search ended and, if it is solved, actions and a checked motion."""

    scene: Scene
    """Scene that was planned."""
    status: PlanStatus
    """Whether a motion was found, and if not, why the search ended."""
    actions: tuple[Action, ...]
    """Actions in their order; empty unless solved."""
    motion: Motion | None
    """Motion that carries out the actions; None unless solved."""
    report: CheckReport | None
    """Report of the independent check on `motion`; None unless solved."""
    path: PathQuality | None
    """Cost of the path and how close it is to an optimum; None unless solved."""
    violations: dict[str, float]
    """Largest violation of each kind of constraint in the path NLP [m or rad]; empty unless solved."""
    seconds: dict[str, float]
    """Time spent on each stage, and "total" [s]; "longer" is the part of all stages that went into sequences of more
    than `k_max` actions."""
    nlps: dict[str, int]
    """Number of NLPs solved for each bound; every start counts."""
    verdicts: dict[str, int]
    """Number of prefixes judged by each bound."""
    rejected: int
    """Number of feasible paths that the independent check refused."""
    reason: Reason | None = None
    """Why the scene has no solution of at most `k_max` actions; None if solved, or if no one reason covers all
    sequences."""
    refuted: tuple[Refutation, ...] = ()
    """The refuted sequences, or beginnings of sequences, that came closest to a solution; empty if solved."""
    options: dict[str, object] = field(default_factory=dict)
    """Search, k_max, seed, checksum of the network (None without one), time limit (None if infinite) [s], factor of the
    clearances, termination of the path, and whether the least number of actions was asked for. The entry
    "longer_k_max" says up to how many actions longer sequences were searched without a result."""
    operators: tuple[Operator, ...] = OPERATORS
    """Operators of the actions; they are not compared and not written to disk."""

    @property
    def solved(self) -> bool:
        """Whether there is a motion that passes the independent check."""
        return self.status == PlanStatus.SOLVED

    @property
    def action_descriptions(self) -> tuple[str, ...]:
        """The actions as English phrases, as in "left grasps yellow at its +x face"."""
        return tuple(describe(action, self.operators) for action in self.actions)

    def __repr__(self) -> str:
        """Return one line: status, number of actions, duration of the motion, planning time."""
        parts = [str(self.status)]

        if self.motion is not None:
            duration = float(self.motion.time[-1] - self.motion.time[0])
            parts.append(f"{len(self.actions)} actions")
            parts.append(f"a motion of {duration:.1f} s")

        if "total" in self.seconds:
            parts.append(f"planned in {self.seconds['total']:.2f} s")

        return f"Plan({', '.join(parts)})"

    def __eq__(self, other: object) -> bool:
        """Compare all fields; motions are equal if their arrays are."""
        if not isinstance(other, Plan):
            return NotImplemented

        plain = [item.name for item in fields(self) if item.name not in ("motion", "operators")]
        if any(getattr(self, name) != getattr(other, name) for name in plain):
            return False

        return _are_equal_motions(self.motion, other.motion)

    __hash__ = None  # type: ignore[assignment]

    def save(self, folder: str | Path, pictures: bool = True, animation: bool = True) -> None:
        """Write the plan into a folder, in place of a plan that it holds.

        The files are `plan.json`, `scene.xml` (the scene for MuJoCo), `depth.png` (what the camera sees) and, if the
        plan is solved, `trajectory.npz`, `film.png` (the state after each action) and `plan.gif`.

        Args:
            folder: Folder for the files; it is made if it is missing.
            pictures: Whether to write `depth.png` and `film.png`.
            animation: Whether to write `plan.gif`, which takes some seconds.

        Raises:
            OSError: A file cannot be written.
        """
        from dvr_jax.planning.plan_files import save_plan

        save_plan(Path(folder), self, pictures, animation)

    @classmethod
    def load(cls, folder: str | Path, operators: Sequence[Operator] = OPERATORS) -> Self:
        """Read a plan that `save` wrote; the result equals the plan that was saved.

        Args:
            folder: Folder that a plan was saved to.
            operators: Operators that the plan's actions may be of.

        Raises:
            DataError: The folder holds no plan, or its files are broken or contradict each other.
            DvrError: The scene or the motion in the folder is broken.
        """
        from dvr_jax.planning.plan_files import load_plan_fields

        return cls(**load_plan_fields(Path(folder), operators))

    def scene_after(self) -> Scene:
        """Return the valid scene that the plan leaves behind.

        Objects stand where the motion leaves them, exactly upright. Overlaps within the tolerances of the check are
        resolved by moving the objects apart. The goal and the home postures are those of the planned scene: the motion
        of the arms back to their homes is no part of the plan.

        Raises:
            MotionError: The plan is not solved, an object is still held at its end, or objects overlap by more than
                the tolerances allow.
        """
        from dvr_jax.planning.scene_after import scene_after

        return scene_after(self)


def _are_equal_motions(first: Motion | None, second: Motion | None) -> bool:
    """Compare two motions array by array."""
    if first is None or second is None:
        return first is second

    names = [item.name for item in fields(Motion)]
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)
