"""The curvature of the constraints against second differences of their rows, at paths through solved keyframes."""

from functools import lru_cache
from typing import NamedTuple

import jax
import numpy as np
import pytest
from nlp_cases import FACING, Floats
from solver_cases import MODEL, random_keyframes

from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, EvaluationInput, Horizon
from dvr_jax.nlp.collision_distances import row_contacts
from dvr_jax.nlp.collision_rows import object_pairs
from dvr_jax.nlp.curvature import CURVED_PER_PHASE, constraint_curvature, times_curvature
from dvr_jax.nlp.evaluation import (
    FlatResiduals,
    evaluate_constraints,
    evaluation_input,
    flatten,
    horizon_of,
    number_of_flat_rows,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, measure
from dvr_jax.nlp.system import BorderedSystem, Curvature
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.nlp.working_rows import RowDerivatives, RowIndex
from dvr_jax.runtime.compilation import Program
from dvr_jax.solver.banded import reduce_sides, solve_reduced
from dvr_jax.solver.lane_pool import solve, stack
from dvr_jax.solver.path_matrix import factorize_convexified
from dvr_jax.solver.state import Settings

STEPS = 4
DIRECTIONS = 8
STEP = 1e-3
TOLERANCE = 2e-2
"""Relative to the matrix' norm: a product with a random direction on both sides is of this order."""

lay_out_program = Program(lay_out)
measure_program = Program(measure)
constraints_program = Program(evaluate_constraints)


class Point(NamedTuple):
    """One path with its geometry."""

    problems: Problem
    x: Variables
    horizon: Horizon
    geometry: SliceGeometry
    given: EvaluationInput


def rows_at(problems: Problem, x: Variables) -> dict[str, Floats]:
    geometry = measure_program(MODEL, lay_out_program(problems, x))
    evaluations = constraints_program(MODEL, problems, x, geometry)
    return {name: np.asarray(evaluation.rows) for name, evaluation in evaluations.items()}


def path_of(keyframes: Problem, generator: np.random.Generator) -> Problem:
    """The path NLP with `STEPS` slices in each phase and samples anywhere between them."""
    K, D = keyframes.regularization_target.shape
    T = K * STEPS
    between = np.sort(generator.uniform(0, 1, (T, 2)), axis=1)
    return keyframes._replace(
        regularization_target=np.zeros((T, D)),
        regularization_weight=np.zeros((T, D)),
        clearance=np.repeat(keyframes.clearance, STEPS, axis=0),
        sample_fraction=np.concatenate([between, np.ones((T, 1))], axis=1),
        sample_offset=np.zeros((T, 3, D)),
    )


@lru_cache
def point() -> Point:
    """A path whose switches are solved keyframes. Its hands hardly turn where a straight motion has to be."""
    generator = np.random.default_rng(4)
    keyframes = [transcribe(FACING.scene, skeleton[:2]) for skeleton in FACING.skeletons] * 25
    starts = [random_keyframes(problem, generator) for problem in keyframes]
    found = solve(MODEL, keyframes, starts, Settings(iteration_limit=60))
    number = next(index for index, result in enumerate(found) if result.feasible)

    problem = path_of(keyframes[number], generator)
    switches = found[number].q
    T = STEPS * len(switches)
    q = np.repeat(switches, STEPS, axis=0) + generator.normal(size=(T, switches.shape[1])) * 0.1
    q[STEPS - 1 :: STEPS] = switches
    q[STEPS::STEPS] = switches[:-1]
    q[STEPS - 3 :: STEPS] = q[STEPS - 2 :: STEPS]
    q[np.arange(T) % STEPS < 2] += generator.normal(size=(T // 2, q.shape[1])) * 1e-3
    problems = stack([problem])
    x = Variables(q[None], found[number].m[None])
    geometry = measure_program(MODEL, lay_out_program(problems, x))
    given = evaluation_input(MODEL, problems, x, geometry)
    return Point(problems, x, horizon_of(MODEL, problems, x), geometry, given)


def second_differences(values: dict[str, Floats], d: Variables) -> float:
    """Second difference along d of the sum of rows times the multipliers `values`."""
    at = point()

    def total(amount: float) -> float:
        x = Variables(at.x.q + amount * d.q, at.x.m + amount * d.m)
        rows = rows_at(at.problems, x)
        return float(sum(np.sum(rows[name] * value) for name, value in values.items()))

    return (total(STEP) - 2 * total(0) + total(-STEP)) / STEP**2


def directions() -> list[Variables]:
    """Random directions along joints alone, parameters alone, and both."""
    at = point()
    generator = np.random.default_rng(0)
    free = np.asarray(at.problems.parameter_upper > at.problems.parameter_lower)
    found = []
    for number in range(DIRECTIONS):
        q = generator.normal(size=at.x.q.shape) * (number % 4 != 3)
        m = generator.normal(size=at.x.m.shape) * free * (number % 4 != 2)
        found.append(Variables(q, m))
    return found


def compare(values: dict[str, Floats], curvature: Curvature) -> None:
    C = jax.tree.map(lambda value: value[0], curvature)
    norm = np.sqrt(sum(np.sum(value**2) for value in C))
    assert norm > 0.1
    for d in directions():
        change = times_curvature(C, Variables(d.q[0], d.m[0]))
        ours = float(np.sum(change.q * d.q[0]) + np.sum(change.m * d.m[0]))
        assert ours == pytest.approx(second_differences(values, d), abs=TOLERANCE * norm)


@pytest.mark.parametrize("name", ["mode_switch", "straight_line", "straight_corridor"])
def test_curvature_of_a_block_is_that_of_second_differences(name: str) -> None:
    at = point()
    (block,) = (block for block in CONSTRAINT_BLOCKS if block.name == name)
    assert block.curvature is not None
    multipliers = np.random.default_rng(1).normal(size=(1, *block.shape(at.horizon)))
    compare({name: multipliers}, block.curvature(at.given, multipliers))


def _flat_rows() -> tuple[Floats, Floats]:
    """Indices of distances with a fixed normal, or with that of a face, whose points do not move; and the others."""
    at = point()
    N = at.problems.prism.shape[1]
    L, P = at.geometry.distance.shape
    rows = np.tile(np.arange(P)[:, None], (1, L))
    contacts = row_contacts(MODEL, at.geometry.contacts, N, rows)
    normal = np.asarray(contacts.wrench[3:])
    on_body = np.asarray(contacts.is_on_body)
    distance = np.asarray(at.geometry.distance).T
    is_vertical = (np.abs(normal[2]) > 1 - 1e-9) & ~on_body

    # The face of an object, and an end of the capsule's axis, or the middle where the capsule is far.
    bodies = at.geometry.contacts.bodies
    capsules = at.geometry.contacts.segments.start.shape[1]
    position = np.full((P, L), 0.5)
    first_on_body = int(np.argmax(on_body[:, 0]))
    pairs = int(on_body[:, 0].sum())
    position[first_on_body : first_on_body + pairs] = at.geometry.contacts.axis_position
    body = np.clip(np.arange(P) - first_on_body, 0, pairs - 1) // capsules
    along = np.einsum("jipl,ipl->jpl", np.asarray(bodies.rotation)[:, :, body], normal)
    is_face = on_body & (np.abs(along).max(axis=0) > 1 - 1e-9) & np.isin(position, [0.0, 0.5, 1.0])
    chosen = (is_vertical | is_face) & (distance < 0.5) & (np.abs(normal).max(axis=0) > 0)

    # Objects may roll on the table, and the contact of two bodies is known up to their size.
    fixed = at.problems.fixed_prism.shape[1]
    chosen[P - len(object_pairs(N, fixed)[0]) - N :] = False
    return np.argwhere(chosen), is_face[chosen]


def test_curvature_of_distances_from_faces_is_that_of_second_differences() -> None:
    at = point()
    found, is_face = _flat_rows()
    assert is_face.any()
    assert not is_face.all()
    generator = np.random.default_rng(2)
    P = at.horizon.collision_rows
    flat = found[:, 1] * P + found[:, 0]
    index = np.concatenate(
        [generator.permutation(flat[is_face])[:12], generator.permutation(flat[~is_face])[:12]]
    ).astype(np.int32)
    shapes = number_of_flat_rows(at.horizon)
    values = np.zeros((1, *shapes.collision))

    # As many working rows as are looked at have a multiplier, in random places among the others.
    number = CURVED_PER_PHASE * at.horizon.phases
    assert number < len(index)
    is_curved = generator.permutation(np.arange(len(index)) % 12 < number // 2)
    values.reshape(-1)[index[is_curved]] = generator.uniform(0.5, 1.5, is_curved.sum())

    multipliers = FlatResiduals(
        values, np.zeros((1, *shapes.equality)), np.zeros((1, *shapes.inequality))
    )
    curvature = constraint_curvature(
        MODEL,
        at.given,
        at.horizon,
        [at.geometry],
        multipliers,
        RowIndex(index[None], np.zeros((1, 1), np.int32)),
    )
    compare({"collision": values}, curvature)


def test_multipliers_by_block_are_those_of_flat_rows() -> None:
    """`constraint_curvature` adds up what the blocks return."""
    at = point()
    generator = np.random.default_rng(3)
    by_block = {
        block.name: generator.normal(size=(1, *block.shape(at.horizon)))
        for block in CONSTRAINT_BLOCKS
    }
    flat = jax.vmap(flatten)(by_block)
    nothing = np.full((1, 1), np.asarray(flat.collision).size, np.int32)
    index = RowIndex(nothing, np.zeros((1, 1), np.int32))
    total = constraint_curvature(MODEL, at.given, at.horizon, [at.geometry], flat, index)
    parts = [
        block.curvature(at.given, by_block[block.name])
        for block in CONSTRAINT_BLOCKS
        if block.curvature is not None
    ]
    expected = sum(np.asarray(part.diagonal) for part in parts)
    np.testing.assert_allclose(total.diagonal, expected, atol=1e-12)


def test_an_indefinite_matrix_gets_less_curvature() -> None:
    """A curvature of a hundred times the matrix is left out, a small one is kept whole."""
    generator = np.random.default_rng(5)
    T, D, M, R = 6, 3, PARAMETERS, 5

    def symmetric(*shape: int) -> Floats:
        value = generator.normal(size=shape)
        return value + value.swapaxes(-1, -2)

    identity = np.eye(D)
    system = BorderedSystem(
        diagonal=np.tile(10 * identity, (T, 1, 1)),
        coupling=np.zeros((T, D, D)),
        far_coupling=np.zeros((T, D)),
        border=np.zeros((T, D, M)),
        corner=10 * np.eye(M),
        gradient_q=np.zeros((T, D)),
        gradient_m=np.zeros(M),
    )
    curvature = Curvature(
        symmetric(T, D, D), np.zeros((T, D, D)), np.zeros((T, D, M)), symmetric(M, M)
    )
    rows = RowDerivatives(np.zeros((T, D, R)), np.zeros((M, R)))
    for factor, kept in ((0.1, 1.0), (1e3, 0.0)):
        scaled = jax.tree.map(lambda value, factor=factor: factor * value, curvature)
        found, share = factorize_convexified(system, scaled, rows, np.zeros(R), np.array(0.0))
        assert share == kept
        expected = system.corner + kept * scaled.corner
        L = np.linalg.inv(np.asarray(found.corner_inverse))
        np.testing.assert_allclose(L @ L.T, expected, atol=1e-9)


def test_penalized_rows_are_part_of_the_matrix() -> None:
    """Against the dense matrix: rows depend on one slice, on the slice before it, and on the parameters."""
    generator = np.random.default_rng(6)
    T, D, M, R = 4, 2, PARAMETERS, 3
    by_joints = np.zeros((T, D, R))
    for row, t in enumerate((0, 2, 3)):
        by_joints[max(t - 1, 0) : t + 1, :, row] = generator.normal(size=(min(t, 1) + 1, D))
    rows = RowDerivatives(by_joints, generator.normal(size=(M, R)))
    weights = np.array([2.0, 0.0, 5.0])
    identity = np.eye(D)
    system = BorderedSystem(
        diagonal=np.tile(identity, (T, 1, 1)),
        coupling=np.zeros((T, D, D)),
        far_coupling=np.zeros((T, D)),
        border=np.zeros((T, D, M)),
        corner=np.eye(M),
        gradient_q=np.zeros((T, D)),
        gradient_m=np.zeros(M),
    )
    nothing = Curvature(
        np.zeros((T, D, D)), np.zeros((T, D, D)), np.zeros((T, D, M)), np.zeros((M, M))
    )
    factor, _ = factorize_convexified(system, nothing, rows, weights, np.array(0.0))
    right = generator.normal(size=T * D + M)
    side = reduce_sides(factor, right[: T * D].reshape(T, D, 1), right[T * D :, None])
    dq, dm = solve_reduced(factor, jax.tree.map(lambda value: value[..., 0], side), T)

    J = np.concatenate([by_joints.reshape(T * D, R), rows.by_parameters]).T
    dense = np.eye(T * D + M) + J.T @ np.diag(weights) @ J
    expected = np.linalg.solve(dense, right)
    np.testing.assert_allclose(np.concatenate([dq.reshape(-1), dm]), expected, atol=1e-9)
