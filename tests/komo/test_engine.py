"""Batched solves: a problem's result does not depend on what else is in the batch, nor on when its lane was filled."""

import numpy as np
from komo_cases import SCENE, SKELETONS

from dvr_jax.bench.recall import random_keyframes
from dvr_jax.komo.augmented import FEASIBLE, ITERATION_LIMIT, STAGNATED, Settings
from dvr_jax.komo.engine import extend_prefixes, solve
from dvr_jax.komo.particles import PARTICLES, empty_prefix
from dvr_jax.komo.transcription import transcribe
from dvr_jax.komo.verdict import PENETRATION_TOLERANCE, POSITION_TOLERANCE, ROTATION_TOLERANCE


def test_solutions_do_not_depend_on_the_batch() -> None:
    """More problems than lanes, so that some lanes are filled again."""
    generator = np.random.default_rng(0)
    problems = [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS] * 25
    starts = [random_keyframes(problem, generator) for problem in problems]
    settings = Settings(iteration_limit=30)
    together = solve(problems, starts, settings)
    assert {result.status for result in together} <= {FEASIBLE, STAGNATED, ITERATION_LIMIT}
    assert len({result.iterations for result in together}) > 2
    for index in (0, 13, 74):
        (alone,) = solve([problems[index]], [starts[index]], settings)
        assert alone.status == together[index].status
        assert alone.iterations == together[index].iterations
        np.testing.assert_array_equal(alone.q, together[index].q)
        np.testing.assert_array_equal(alone.m, together[index].m)


def test_feasible_means_within_the_tolerances() -> None:
    generator = np.random.default_rng(1)
    problems = [transcribe(SCENE, SKELETONS[0][:1])] * 30
    results = solve(problems, [random_keyframes(problem, generator) for problem in problems], Settings())
    feasible = [result for result in results if result.feasible]
    assert feasible
    for result in feasible:
        assert result.violations["position"] <= POSITION_TOLERANCE
        assert result.violations["rotation"] <= ROTATION_TOLERANCE
        assert result.violations["penetration"] <= PENETRATION_TOLERANCE
    assert all(result.ratio > 1 for result in results if not result.feasible)


def test_particles_do_not_depend_on_the_batch() -> None:
    grasps = [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS]
    root = empty_prefix(3, 4)
    together = extend_prefixes([root] * 9, grasps * 3, seed=5)
    for index in (0, 8):
        (alone,) = extend_prefixes([root], [grasps[index % 3]], seed=5)
        for ours, theirs in zip(together[index], alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert together[0].violation.shape == (PARTICLES,)
    (other,) = extend_prefixes([root], [grasps[0]], seed=6)
    assert (other.q != together[0].q).any()
