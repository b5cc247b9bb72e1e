"""The NLP's rows and Jacobians, compiled once for each kind of case, shared by all tests here."""

from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
from nlp_cases import FIXED, SIDE_BY_SIDE, SINGLE_ARM, STACKS, Case, Floats, make_case

from dvr_jax.nlp.collision_rows import arm_row_signs
from dvr_jax.nlp.evaluation import evaluate_constraints
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, distance_jacobian, measure
from dvr_jax.runtime.compilation import Program
from dvr_jax.workcell.model import WorkcellModel


class Results(NamedTuple):
    """All that is known of a batch of points."""

    rows: dict[str, Floats]
    """Rows of each block (B, ...)."""

    jacobians: dict[str, Any]
    """Their derivatives, in each block's own structure."""

    violations: dict[str, tuple[Floats, ...]]
    """Violations of each block's measures (B,)."""

    distance_jacobian: Floats
    """Derivatives of all distances by their own slice's columns (B, T', C, P)."""

    geometry: SliceGeometry

    @property
    def distance(self) -> Floats:
        return -self.rows["collision"]


# Programs of the package's own functions are kept on disk, so that only the first run of the tests waits for them.
lay_out_program = Program(lay_out)
measure_program = Program(measure)
constraints_program = Program(evaluate_constraints)
jacobian_program = Program(distance_jacobian)


def evaluate(model: WorkcellModel, problems: Problem, x: Variables) -> Results:
    B = len(x.q)
    geometry = measure_program(model, lay_out_program(problems, x))
    evaluations = constraints_program(model, problems, x, geometry)
    L, P = geometry.distance.shape
    J = jacobian_program(model, geometry, np.tile(np.arange(P), (L, 1)))
    return Results(
        {name: evaluation.rows for name, evaluation in evaluations.items()},
        {name: evaluation.jacobian for name, evaluation in evaluations.items()},
        {name: evaluation.violation for name, evaluation in evaluations.items()},
        J.reshape(B, L // B, -1, P),
        geometry,
    )


def evaluate_rows(model: WorkcellModel, problems: Problem, x: Variables) -> dict[str, Floats]:
    """Rows alone, for central differences."""
    evaluations = constraints_program(
        model, problems, x, measure_program(model, lay_out_program(problems, x))
    )
    return {name: np.asarray(evaluation.rows) for name, evaluation in evaluations.items()}


class Evaluated:
    """A case with its rows and Jacobians at its own points and at others of the same shape."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.model = case.setting.model
        self.arm_rows = arm_row_signs(self.model.structure).shape[1]
        """Number of rows of arms alone."""

        self.joints = self.model.structure.number_of_joints

    @cached_property
    def results(self) -> Results:
        return self.of(self.case.problems, self.case.x)

    @property
    def distance(self) -> Floats:
        return self.results.distance

    def of(self, problems: Problem, x: Variables) -> Results:
        return jax.tree.map(np.asarray, evaluate(self.model, problems, x))

    def rows_of(self, problems: Problem, x: Variables) -> dict[str, Floats]:
        return evaluate_rows(self.model, problems, x)

    def moved(self, kind: str, index: tuple[object, ...], amount: float) -> dict[str, Floats]:
        """Rows after a change of some joint angles ("q") or mode parameters ("m")."""
        return self.rows_of(self.case.problems, move(self.case.x, kind, index, amount))

    @cached_property
    def hands(self) -> tuple[Floats, Floats]:
        """Rotations (B, T', A, 3, 3) and positions (B, T', A, 3) of the grippers."""
        B, T = self.case.batch, self.case.number_of_samples
        R, p = self.results.geometry.hands
        by_slice = np.moveaxis(R, (3, 2, 1, 0), (0, 1, 2, 3)), np.moveaxis(p, (2, 1, 0), (0, 1, 2))
        return tuple(value.reshape(B, T, *value.shape[1:]) for value in by_slice)

    def hands_at(self, b: int, sample: int) -> list[tuple[Floats, Floats]]:
        R, p = self.hands
        return list(zip(R[b, sample], p[b, sample], strict=True))

    def switch_sample(self, k: int) -> int:
        return (k + 1) * self.case.steps * self.case.samples - 1


def move(x: Variables, kind: str, index: tuple[object, ...], amount: float) -> Variables:
    changed: Floats = np.array(getattr(x, kind))
    changed[index] += amount
    return x._replace(**{kind: changed})


@pytest.fixture(scope="session")
def keyframes() -> Evaluated:
    return Evaluated(make_case(steps=1, repeats=16, seed=0))


@pytest.fixture(scope="session")
def path() -> Evaluated:
    return Evaluated(make_case(steps=3, repeats=4, seed=0))


@pytest.fixture(scope="session")
def coarse_path() -> Evaluated:
    """With distances at its slices alone."""
    return Evaluated(make_case(steps=3, repeats=1, seed=0, samples=1))


@pytest.fixture(scope="session")
def fixed_bodies() -> Evaluated:
    """A path among fixed bodies."""
    return Evaluated(make_case(steps=3, repeats=3, seed=2, setting=FIXED))


@pytest.fixture(scope="session")
def single_arm() -> Evaluated:
    """A path of one arm before a screen."""
    return Evaluated(make_case(steps=3, repeats=5, seed=3, setting=SINGLE_ARM))


@pytest.fixture(scope="session")
def side_by_side() -> Evaluated:
    """A path of arms that stand side by side."""
    return Evaluated(make_case(steps=3, repeats=3, seed=0, setting=SIDE_BY_SIDE))


@pytest.fixture(scope="session")
def stacks() -> Evaluated:
    """Keyframes at which objects are put on other objects."""
    return Evaluated(make_case(steps=1, repeats=6, seed=4, setting=STACKS))


@pytest.fixture(
    scope="session",
    params=["keyframes", "path", "fixed_bodies", "single_arm", "side_by_side", "stacks"],
)
def evaluated(request: pytest.FixtureRequest) -> Evaluated:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session", params=[(1, 16, 2), (3, 4, 3)], ids=["keyframes", "path"])
def level(request: pytest.FixtureRequest) -> Evaluated:
    """Held objects nearly upright: faces of two objects face each other, if seldom while hands rest above them."""
    return Evaluated(make_case(*request.param, level=True))
