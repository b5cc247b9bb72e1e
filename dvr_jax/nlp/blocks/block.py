"""A constraint block is a set of scalar constraints of one kind; this module also defines the records that blocks use.

A *row* is one scalar constraint. A `ConstraintBlock` defines the shape, the values and the derivatives of its rows,
their penalties and tolerances, and what they add to the Gauss-Newton system. The constraints of the NLP are one tuple
of blocks (`dvr_jax.nlp.blocks.CONSTRAINT_BLOCKS`). By convention, an equality is h = 0 and an inequality is g <= 0.

For the row with the value c, multiplier y and penalty p, the solver (`dvr_jax.solver.augmented_lagrangian`) gives a
block two numbers:

- the *multiplier estimate*, the derivative of the augmented Lagrangian by the row: ``y + p c`` for an equality and
  ``max(0, y + p c)`` for an inequality;
- the *active penalty*: p if the row is active, else 0. Equalities are always active, inequalities if their multiplier
  estimate is positive.

A block with the Jacobian J, the vector e of multiplier estimates and the vector a of active penalties adds ``J^T e`` to
the gradient and ``J^T diag(a) J`` to the Gauss-Newton matrix.
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
from dvr_jax.nlp.system import Curvature, SystemParts


class ConstraintKind(Enum):
    """Whether the rows of a block are equalities or inequalities."""

    EQUALITY = "equality"
    """The rows are h = 0."""

    INEQUALITY = "inequality"
    """The rows are g <= 0."""


@dataclass(frozen=True, slots=True)
class Horizon:
    """The sizes of one NLP."""

    slices: int
    """Number T of slices."""

    phases: int
    """Number K of phases, which is the number of actions."""

    samples: int
    """Number M of samples in the interval before each slice."""

    joints: int
    """Number D of joints of all arms together."""

    collision_rows: int
    """Number P of distances at each sample."""

    kept_clear: int = 0
    """Number C of regions that have to be clear at the end."""

    tops: int = 0
    """1 in a scene in which objects are supports, else 0."""

    @property
    def is_path(self) -> bool:
        """Whether the NLP is a path NLP: there are slices between the switches."""
        return self.slices > self.phases

    @property
    def steps(self) -> int:
        """Number S of slices in each phase."""
        return self.slices // self.phases


class SwitchGeometry(NamedTuple):
    """Geometry at the switches of a batch of B problems; the last axis has B K switches, problem after problem."""

    hands: HandPoses
    """Poses of the grippers, with the batch axes (A, B K)."""

    screws: Float[Array, "6 joints switches"]
    """World twist of each joint at unit velocity: angular velocity, then velocity of the point at the origin."""


class Evaluation(NamedTuple):
    """Rows of one block for a batch of B problems, with their derivatives and violations."""

    rows: Float[Array, "batch *shape"]
    """Values of the rows, h or g."""

    jacobian: Any
    """Derivatives of the rows, in any structure that the block's `add_to_system` reads. Every array has a leading axis
    B. It is None if `add_to_system` needs none."""

    violation: tuple[Float[Array, " batch"], ...]
    """Largest violation of each of the block's `measures`, in their order; zero or positive."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One number by which violations of a block are measured."""

    name: str
    """Name in results, as in "penetration"."""

    unit: str
    """Unit of the violation, as in "m"."""

    tolerance: float
    """Largest violation that a feasible point may have."""


class EvaluationInput(NamedTuple):
    """Everything that the rows of a block are computed from, for a batch of B problems."""

    problems: Problem
    """The problems, with a leading axis B."""

    x: Variables
    """The point at which the rows are evaluated, with a leading axis B."""

    distance: Float[Array, "batch samples rows"]
    """Signed distances at all T M samples of each problem, with P rows for each sample [m]."""

    switches: SwitchGeometry
    """Poses of the grippers and twists of the joints at the switches."""

    hands: HandPoses
    """Poses of the grippers at all samples, with the batch axes (A, B, T M)."""

    screws: Float[Array, "6 joints batch samples"]
    """World twists of the joints at all samples."""

    joint_limits: Float[Array, "2 joints"]
    """Lower and upper limits of all joints [rad]."""


Evaluate = Callable[[EvaluationInput], Evaluation]
"""Function that evaluates all rows of a block."""

AddToSystem = Callable[[SystemParts, Problem, Variables, Any, Array, Array], SystemParts]
"""Function that adds the rows of a block to a Gauss-Newton system; see `ConstraintBlock.add_to_system`."""


EmptyJacobian = Callable[[Horizon, Callable[..., Any]], Any]
"""Function that returns a placeholder of a block's Jacobian; see `ConstraintBlock.empty_jacobian`."""


GetCurvature = Callable[[EvaluationInput, Array], Curvature]
"""Function that returns second derivatives of a block's rows; see `ConstraintBlock.curvature`."""


def no_jacobian(horizon: Horizon, zeros: Callable[..., Any]) -> None:
    """Return None, the Jacobian of a block whose derivatives are constant or kept elsewhere.

    Args:
        horizon: Sizes of the NLP.
        zeros: Function that returns an array of zeros of a shape.
    """


@dataclass(frozen=True)
class ConstraintBlock:
    """A set of scalar constraints of one kind: their shape, values, derivatives, penalties and tolerances."""

    name: str
    """Name of the block, unique among the blocks."""

    kind: ConstraintKind
    """Whether the rows are equalities or inequalities."""

    measures: tuple[Measure, ...]
    """The quantities by which violations are measured, each with its unit and tolerance."""

    shape: Callable[[Horizon], tuple[int, ...]]
    """Function that returns the shape of the rows of one problem."""

    scale: Callable[[Horizon], Float[np.ndarray, "*shape"] | float]
    """Function that returns the factor by which the penalty of each row differs from the solver's common penalty: an
    array of the rows' shape, or one number. The factors bring meters and radians to a common scale."""

    evaluate: Evaluate
    """Function that returns values, derivatives and violations of all rows of a batch of problems."""

    add_to_system: AddToSystem
    """Function that returns the Gauss-Newton system with the rows of one problem (without batch axes) added to it.
    It is called as ``add_to_system(parts, problem, x, jacobian, multiplier_estimate, active_penalty)``; `jacobian` is
    that of the problem's `Evaluation`, and the last two arrays have the shape of the rows."""

    empty_jacobian: EmptyJacobian = no_jacobian
    """Function that returns a Jacobian of the right structure with all derivatives zero, for the sizes of an NLP. It is
    called as ``empty_jacobian(horizon, zeros)``, where ``zeros(*shape)`` adds batch axes. Equalities need it, because
    the solver keeps their Jacobians between iterations."""

    curvature: GetCurvature | None = None
    """Function that returns the second derivatives of the sum of all rows times their multipliers, for a batch of
    problems. It is called as ``curvature(given, multipliers)``. None where they are zero or left out."""
