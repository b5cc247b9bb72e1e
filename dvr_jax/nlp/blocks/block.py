"""What a block of constraints is, and the records that blocks work on.

A block is a set of constraint rows of one kind: a value that holds the rows' shape, their values and derivatives, their
scale, their tolerances, and what they add to the Gauss-Newton system. The NLP is one tuple of blocks
(`dvr_jax.nlp.blocks.CONSTRAINT_BLOCKS`). Sign conventions: an equality is h = 0, an inequality g <= 0.

The augmented Lagrangian gives each row a multiplier estimate y (its derivative of the Lagrangian) and an active
penalty p (its penalty where the row counts, else 0). A block with Jacobian J adds ``J^T y`` to the gradient and ``J^T
diag(p) J`` to the Gauss-Newton matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import HandPoses
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import SystemParts


class ConstraintKind(Enum):
    """Whether the rows of a block are equalities."""

    EQUALITY = "equality"
    INEQUALITY = "inequality"


@dataclass(frozen=True, slots=True)
class Horizon:
    """The sizes of one NLP."""

    slices: int
    """Number T."""

    phases: int
    """Number K."""

    samples: int
    """Number M of samples of a slice."""

    joints: int
    """Number D of joints of all arms."""

    collision_rows: int
    """Number P of distances of a sample."""

    @property
    def is_path(self) -> bool:
        """Whether there are slices between the switches."""
        return self.slices > self.phases

    @property
    def steps(self) -> int:
        """Number S of slices of a phase."""
        return self.slices // self.phases


class SwitchGeometry(NamedTuple):
    """Geometry of the switch slices of a batch of B problems; the last axis counts B K switches, problem by problem."""

    hands: HandPoses
    """Poses of the grippers, batch axes (A, B K)."""

    screws: Float[Array, "6 joints switches"]
    """World twists of all joints."""


class Evaluation(NamedTuple):
    """Rows of one block of a batch of B problems."""

    rows: Float[Array, "batch *shape"]
    """Values of the rows."""

    jacobian: Any
    """Derivatives of the rows, in the block's own structure; every leaf has a leading axis B. None where the block
    needs none."""

    violation: tuple[Float[Array, " batch"], ...]
    """Largest violation of each of the block's measures, zero or positive."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One number by which violations of a block are measured."""

    name: str
    """Name in results, as in "penetration"."""

    unit: str
    """Unit of the violation."""

    tolerance: float
    """Largest violation of a feasible point."""


class EvaluationInput(NamedTuple):
    """What a block's rows are computed from, for a batch of B problems."""

    problems: Problem
    x: Variables
    distance: Float[Array, "batch samples rows"]
    """Signed distances of every sample [m]."""

    switches: SwitchGeometry
    joint_limits: Float[Array, "2 joints"]
    """Lower and upper limits of all joints [rad]."""


Evaluate = Callable[[EvaluationInput], Evaluation]
AddToSystem = Callable[[SystemParts, Problem, Variables, Any, Array, Array], SystemParts]


@dataclass(frozen=True)
class ConstraintBlock:
    """A set of constraint rows of one kind."""

    name: str
    """Unique among the blocks."""

    kind: ConstraintKind

    measures: tuple[Measure, ...]
    """What the violation is measured by."""

    shape: Callable[[Horizon], tuple[int, ...]]
    """Shape of the rows of one problem."""

    scale: Callable[[Horizon], Float[np.ndarray, "*shape"] | float]
    """Penalty of each row relative to the solver's common one, which brings meters and radians to a common scale; an
    array of the rows' shape, or one number."""

    evaluate: Evaluate
    """Values, derivatives and violations of all rows of a batch."""

    add_to_system: AddToSystem
    """Called as ``add_to_system(parts, problem, x, jacobian, multiplier_estimate, active_penalty)`` for one problem (no
    batch axes); returns the system with the block's part added."""
