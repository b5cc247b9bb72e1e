"""The bordered banded solver against NumPy's dense solve."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from nlp_cases import written_out

from dvr_jax.nlp.system import BorderedSystem
from dvr_jax.solver.banded import (
    ReducedSides,
    factorize_bordered,
    reduce_sides,
    solve_bordered,
    solve_reduced,
)


def sample_system(phases: int, steps: int, joints: int = 14, seed: int = 0) -> BorderedSystem:
    """A positive definite system of a problem's size: blocks dominate what couples them."""
    generator = np.random.default_rng(seed)
    T = phases * steps
    M = 4 * phases
    half = generator.normal(size=(T, joints, joints))
    wide = generator.normal(size=(M, 2 * M))
    border = generator.normal(size=(T, joints, M)) / np.sqrt(T)
    near = generator.normal(size=(T, joints, joints)) / 4
    far = generator.normal(size=(T, joints))
    return BorderedSystem(
        diagonal=jnp.asarray(half @ half.swapaxes(1, 2) + 8 * np.eye(joints)),
        coupling=jnp.asarray(near) if steps > 1 else None,
        far_coupling=jnp.asarray(far) if steps > 1 else None,
        border=jnp.asarray(border),
        corner=jnp.asarray(wide @ wide.T + 30 * np.eye(M)),
        gradient_q=jnp.asarray(generator.normal(size=(T, joints))),
        gradient_m=jnp.asarray(generator.normal(size=M)),
    )


@pytest.mark.parametrize(("phases", "steps"), [(1, 1), (6, 1), (1, 2), (1, 3), (2, 3), (6, 10)])
@pytest.mark.parametrize("damping", [0.0, 0.7])
@pytest.mark.parametrize("joints", [6, 14])
def test_against_a_dense_solve(phases: int, steps: int, damping: float, joints: int) -> None:
    """Also for arms with other numbers of joints than two Pandas have."""
    system = sample_system(phases, steps, joints)
    H = written_out(system)
    assert np.linalg.eigvalsh(H).min() > 1e-3, "the sample is not positive definite"
    dq, dm = jax.jit(solve_bordered)(system, damping)
    ours = np.concatenate([np.ravel(dq), dm])
    right = -np.concatenate([np.ravel(system.gradient_q), system.gradient_m])
    expected = np.linalg.solve(H + damping * np.eye(len(H)), right)
    np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("steps", [1, 4])
def test_an_indefinite_matrix_gives_nan(steps: int) -> None:
    system = sample_system(2, steps)
    diagonal = system.diagonal.at[0].add(-1e3 * jnp.eye(system.diagonal.shape[-1]))
    dq, dm = solve_bordered(system._replace(diagonal=diagonal), 0.0)
    assert np.isnan(dm).any()
    assert np.isnan(dq).any()
    dq, _ = solve_bordered(system._replace(diagonal=diagonal), 2e3)
    assert np.isfinite(dq).all()


@pytest.mark.parametrize("phases", [1, 3])
def test_a_factor_solves_for_later_right_hand_sides(phases: int) -> None:
    """Products of reduced sides are those with the inverse matrix, and the backward sweep gives the solution."""
    system = sample_system(phases, 4)
    T, D = system.gradient_q.shape
    M = len(system.gradient_m)
    damping = 0.3
    inverse = np.linalg.inv(written_out(system) + damping * np.eye(T * D + M))
    sides = np.random.default_rng(1).normal(size=(T * D + M, 5))

    factor = jax.jit(factorize_bordered)(system, damping)
    reduced = reduce_sides(factor, sides[: T * D].reshape(T, D, 5), sides[T * D :])
    flat = np.concatenate([np.reshape(reduced.of_joints, (-1, 5)), reduced.of_parameters])
    np.testing.assert_allclose(flat.T @ flat, sides.T @ inverse @ sides, rtol=1e-8)

    one = ReducedSides(reduced.of_joints[..., 2], reduced.of_parameters[..., 2])
    dq, dm = solve_reduced(factor, one, T)
    np.testing.assert_allclose(
        np.concatenate([np.ravel(dq), dm]), inverse @ sides[:, 2], rtol=1e-8, atol=1e-11
    )
