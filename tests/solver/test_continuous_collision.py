"""Samples of a path move to where its motion penetrates, and lie on the motion."""

import numpy as np
import pytest
from nlp_cases import SCENE, SKELETONS
from solver_cases import JOINTS

from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.solver.continuous_collision import (
    BETWEEN_TOLERANCE,
    PATH_SAMPLES,
    even_fractions,
    exchange_samples,
    raised_clearance,
    straight_intervals,
)


def test_samples_move_to_the_deepest_place_of_their_part_and_lie_on_the_motion() -> None:
    problem = transcribe(SCENE, SKELETONS[0][:2])
    T = 20
    q = problem.home + np.random.default_rng(0).normal(size=(T, JOINTS)) * 0.3
    problem = problem._replace(sample_fraction=even_fractions(T))
    fraction = np.tile([0.1, 0.2, 0.4, 0.5, 0.6, 0.8, 0.9, 0.35, 0.85], (T, 1))
    depth = np.zeros((T, 9))
    depth[3, [1, 2]] = BETWEEN_TOLERANCE + 0.001, BETWEEN_TOLERANCE + 0.002
    depth[3, 5] = BETWEEN_TOLERANCE + 0.001
    depth[4, [2, 7]] = BETWEEN_TOLERANCE + 0.001, BETWEEN_TOLERANCE + 0.002
    depth[5, 6] = BETWEEN_TOLERANCE - 0.001
    moved = exchange_samples(problem, q, fraction, depth)
    expected = even_fractions(T)
    expected[3] = 0.4, 0.8, 1
    expected[4, 0] = 0.35
    np.testing.assert_allclose(moved.sample_fraction, expected, atol=1e-15)
    assert expected.shape == (T, PATH_SAMPLES)
    knots = np.concatenate([problem.home[None], q])
    straight = straight_intervals(problem, T)
    curve = joint_curve(problem.home, q, straight)

    # The left arm grasps in phase 0 and gives in phase 1, in which the right one comes to grasp.
    assert np.argwhere(straight).tolist() == [[8, 0], [18, 1]]
    for t in range(T):
        line = knots[t] + moved.sample_fraction[t][:, None] * (knots[t + 1] - knots[t])
        at_samples = line + moved.sample_offset[t]
        # Where an arm moves straight in joint space, its samples are on the line between the two slices.
        for arm in range(2):
            own = slice(7 * arm, 7 * arm + 7)
            expected_angles = line if straight[t, arm] else curve(t + moved.sample_fraction[t])
            np.testing.assert_allclose(at_samples[:, own], expected_angles[:, own], atol=1e-12)


@pytest.mark.parametrize("samples", [2, 4])
def test_samples_that_do_not_divide_the_times_looked_at_are_refused(samples: int) -> None:
    with pytest.raises(ValueError, match=f"{samples} samples a slice; valid are divisors of 9"):
        even_fractions(5, samples)


def test_clearances_grow_where_an_optimal_path_penetrates() -> None:
    clearance = np.full((3, 2), 0.005)
    depth = np.array([[-0.1, 0.0], [0.001, BETWEEN_TOLERANCE], [0.008, 0.004]])
    raised = raised_clearance(clearance, depth)
    np.testing.assert_allclose(raised, [[0.005] * 2, [0.005] * 2, [0.013] * 2])
