"""Batched solves: a problem's result does not depend on what else is in the batch, nor on when its lane was filled."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest
from nlp_cases import SCENE, SKELETONS, violations_of
from solver_cases import MODEL, random_keyframes
from threadpoolctl import threadpool_info, threadpool_limits

from dvr_jax.errors import DvrError
from dvr_jax.nlp.evaluation import TOLERANCES, relative_violation
from dvr_jax.nlp.problem import Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime import batch_sizes
from dvr_jax.runtime.batch_sizes import CPU
from dvr_jax.solver import iteration
from dvr_jax.solver.lane_pool import solve, stack
from dvr_jax.solver.state import Settings, SolverStatus


def test_solutions_do_not_depend_on_the_batch() -> None:
    """More problems than lanes, so that some lanes are filled again."""
    generator = np.random.default_rng(0)
    problems = [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS] * 25
    starts = [random_keyframes(problem, generator) for problem in problems]
    settings = Settings(iteration_limit=30)
    together = solve(MODEL, problems, starts, settings)
    assert {result.status for result in together} <= {
        SolverStatus.FEASIBLE,
        SolverStatus.STAGNATED,
        SolverStatus.ITERATION_LIMIT,
    }
    assert len({result.iterations for result in together}) > 2
    for index in (0, 13, 74):
        (alone,) = solve(MODEL, [problems[index]], [starts[index]], settings)
        assert alone.status == together[index].status
        assert alone.iterations == together[index].iterations
        np.testing.assert_array_equal(alone.q, together[index].q)
        np.testing.assert_array_equal(alone.m, together[index].m)


def test_larger_buckets_change_nothing_but_the_last_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More slices than fit into a CPU's chunks, as an accelerator has them (its passes: tests/nlp/test_slices.py)."""
    monkeypatch.setenv("DVR_JAX_CACHE", "off")  # programs are kept by their shapes
    generator = np.random.default_rng(0)
    problems = [transcribe(SCENE, skeleton[:2]) for skeleton in SKELETONS] * 25
    starts = [random_keyframes(problem, generator) for problem in problems]
    settings = Settings(iteration_limit=20)
    small = solve(MODEL, problems, starts, settings)
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, chunk=240, largest_chunk=480))
    for ours, theirs in zip(solve(MODEL, problems, starts, settings), small, strict=True):
        assert (ours.iterations, ours.status) == (theirs.iterations, theirs.status)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-6)
        np.testing.assert_allclose(ours.m, theirs.m, atol=1e-6)
    assert len({result.iterations for result in small}) > 2


def test_linear_algebra_keeps_to_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []

    original = iteration.step

    def step(*args: Any) -> Any:
        threads.extend(
            library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
        )
        return original(*args)

    monkeypatch.setattr(iteration, "step", step)
    problem = transcribe(SCENE, SKELETONS[0][:1])
    with threadpool_limits(limits=2, user_api="blas"):
        solve(
            MODEL,
            [problem],
            [random_keyframes(problem, np.random.default_rng(0))],
            Settings(iteration_limit=2),
        )
    assert set(threads) == {1}


def test_solving_without_64_bit_numbers_is_refused() -> None:
    problem = transcribe(SCENE, SKELETONS[0][:1])
    start = random_keyframes(problem, np.random.default_rng(0))
    with jax.enable_x64(False), pytest.raises(DvrError, match=r"call it under jax\.enable_x64"):
        solve(MODEL, [problem], [start], Settings())


def test_feasible_means_that_the_returned_point_is_within_the_tolerances() -> None:
    generator = np.random.default_rng(1)
    problems = [transcribe(SCENE, SKELETONS[0][:1])] * 30
    results = solve(
        MODEL, problems, [random_keyframes(problem, generator) for problem in problems], Settings()
    )
    assert 3 < sum(result.feasible for result in results) < 27
    points = Variables(
        np.stack([result.q for result in results]), np.stack([result.m for result in results])
    )
    measured = violations_of(MODEL, stack(problems), points)
    np.testing.assert_array_equal(
        np.asarray(relative_violation(measured)) <= 1, [result.feasible for result in results]
    )
    assert set(measured) == set(TOLERANCES)
    for name, values in measured.items():
        np.testing.assert_allclose(
            values, [result.violations[name] for result in results], rtol=1e-9, atol=1e-12
        )
