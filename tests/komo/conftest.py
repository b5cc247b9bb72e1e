"""The NLP's rows and AllJacobians, compiled once for keyframes and once for a path, shared by all tests here."""

from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dvr_jax.nlp.constraints import ConstraintValues, Jacobians, collect, lay_out
from komo_cases import Case, Floats, make_case

from dvr_jax.nlp.collision_rows import arm_signs
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, distance_jacobian, measure


class AllJacobians(NamedTuple):
    """Derivatives of all rows; those of distances by their own slice's columns."""

    arm_q: Floats
    """(B, T', 14, Pa)."""
    object_q: Floats
    """(B, T', 14, Po)."""
    object_m: Floats
    """(B, T', 4 N, Po)."""
    arm_m: Floats
    """(B, T', 4 N, Pa)."""
    slopes: Jacobians


def evaluate(problems: Problem, x: Variables) -> tuple[ConstraintValues, AllJacobians, SliceGeometry]:
    B = len(x.q)
    measured = measure(lay_out(problems, x))
    rows, slopes = collect(problems, x, measured.distance, measured.hand_R, measured.hand_p, measured.screws)
    L, P = measured.distance.shape
    J = distance_jacobian(measured, jnp.broadcast_to(jnp.arange(P), (L, P))).reshape(B, L // B, -1, P)
    arm = arm_signs().shape[1]
    return (
        rows,
        AllJacobians(J[:, :, :14, :arm], J[:, :, :14, arm:], J[:, :, 14:, arm:], J[:, :, 14:, :arm], slopes),
        measured,
    )


COMPILED = jax.jit(evaluate)


class Evaluated:
    """A case with its rows and AllJacobians at its own points and at others of the same shape."""

    def __init__(self, case: Case) -> None:
        self.case = case

    @cached_property
    def results(self) -> tuple[ConstraintValues, AllJacobians, SliceGeometry]:
        return self.of(self.case.problems, self.case.x)

    @property
    def rows(self) -> ConstraintValues:
        return self.results[0]

    @property
    def jacobians(self) -> AllJacobians:
        return self.results[1]

    def of(self, problems: Problem, x: Variables) -> tuple[ConstraintValues, AllJacobians, SliceGeometry]:
        return jax.tree.map(np.asarray, COMPILED(problems, x))

    def moved(self, kind: str, index: tuple[object, ...], amount: float) -> ConstraintValues:
        """ConstraintValues after a change of some joint angles ("q") or mode parameters ("m")."""
        return self.of(self.case.problems, move(self.case.x, kind, index, amount))[0]


def move(x: Variables, kind: str, index: tuple[object, ...], amount: float) -> Variables:
    changed: Floats = np.array(getattr(x, kind))
    changed[index] += amount
    return x._replace(**{kind: changed})


@pytest.fixture(scope="session")
def keyframes() -> Evaluated:
    return Evaluated(make_case(steps=1, repeats=6, seed=0))


@pytest.fixture(scope="session")
def path() -> Evaluated:
    return Evaluated(make_case(steps=3, repeats=4, seed=0))


@pytest.fixture(scope="session")
def coarse_path() -> Evaluated:
    """With distances at its slices alone."""
    return Evaluated(make_case(steps=3, repeats=1, seed=0, samples=1))


@pytest.fixture(params=["keyframes", "path"])
def evaluated(request: pytest.FixtureRequest) -> Evaluated:
    return request.getfixturevalue(request.param)


@pytest.fixture(params=[(1, 16, 2), (3, 4, 3)], ids=["keyframes", "path"])
def level(request: pytest.FixtureRequest) -> Evaluated:
    """Held objects nearly upright: faces of two objects face each other, if seldom while hands rest above them."""
    return Evaluated(make_case(*request.param, level=True))
