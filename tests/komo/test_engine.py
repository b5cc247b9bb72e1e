"""Batched solves: a problem's result does not depend on what else is in the batch, nor on when its lane was filled."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest
from komo_cases import SCENE, SKELETONS, violations_of
from threadpoolctl import threadpool_info, threadpool_limits

from dvr_jax.bench.recall import random_keyframes
from dvr_jax.errors import DvrError
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime import batch_sizes as batch_sizes
from dvr_jax.runtime.batch_sizes import CPU
from dvr_jax.search.work import Extend, Steps, run_alone, run_together
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, KeyframeBeam, empty_prefix
from dvr_jax.solver import engine
from dvr_jax.solver import iteration as solver
from dvr_jax.solver.augmented_lagrangian import FEASIBLE, ITERATION_LIMIT, STAGNATED, Settings
from dvr_jax.solver.lane_pool import beam_lanes, extend_beams, solve


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


def test_larger_buckets_change_nothing_but_the_last_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More slices than fit into a CPU's chunks, more prefixes side by side, as an accelerator has them (its passes:
    test_slices.py)."""
    monkeypatch.setenv("DVR_JAX_CACHE", "off")  # programs are kept by their shapes
    generator = np.random.default_rng(0)
    problems = [transcribe(SCENE, skeleton[:2]) for skeleton in SKELETONS] * 25
    starts = [random_keyframes(problem, generator) for problem in problems]
    root, grasps = empty_prefix(3, 4), [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS] * 3
    settings = Settings(iteration_limit=20)
    small = solve(problems, starts, settings)
    few = extend_beams([root] * 9, grasps, 5, beam_lanes(grasps))
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, chunk=240, largest_chunk=480, beam_lanes=16, few=0))
    for ours, theirs in zip(solve(problems, starts, settings), small, strict=True):
        assert (ours.iterations, ours.status) == (theirs.iterations, theirs.status)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-6)
        np.testing.assert_allclose(ours.m, theirs.m, atol=1e-6)
    assert len({result.iterations for result in small}) > 2
    assert beam_lanes(grasps) == [16] * len(grasps)
    for ours, theirs in zip(extend_beams([root] * 9, grasps, 5, [16] * 9), few, strict=True):
        np.testing.assert_allclose(ours.violation, theirs.violation, atol=1e-5)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-4)


def test_linear_algebra_keeps_to_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []

    def iterate(*args: Any) -> Any:
        threads.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return solver.iterate(*args)

    monkeypatch.setattr(engine, "iterate", iterate)
    problem = transcribe(SCENE, SKELETONS[0][:1])
    with threadpool_limits(limits=2, user_api="blas"):
        solve([problem], [random_keyframes(problem, np.random.default_rng(0))], Settings(iteration_limit=2))
    assert set(threads) == {1}


def test_solving_without_64_bit_numbers_is_refused() -> None:
    problem = transcribe(SCENE, SKELETONS[0][:1])
    start = random_keyframes(problem, np.random.default_rng(0))
    with jax.enable_x64(False), pytest.raises(DvrError, match=r"call it under jax\.enable_x64"):
        solve([problem], [start], Settings())


def test_feasible_means_that_the_returned_point_is_within_the_tolerances() -> None:
    generator = np.random.default_rng(1)
    problems = [transcribe(SCENE, SKELETONS[0][:1])] * 30
    results = solve(problems, [random_keyframes(problem, generator) for problem in problems], Settings())
    assert 3 < sum(result.feasible for result in results) < 27
    points = Variables(np.stack([result.q for result in results]), np.stack([result.m for result in results]))
    measured = violations_of(engine.stack(problems), points)
    np.testing.assert_array_equal(np.asarray(measured.ratio()) <= 1, [result.feasible for result in results])
    for name, values in measured._asdict().items():
        np.testing.assert_allclose(values, [result.violations[name] for result in results], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("lanes", [1, CPU.beam_lanes])
def test_particles_do_not_depend_on_the_batch(lanes: int) -> None:
    grasps = [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS]
    root = empty_prefix(3, 4)
    together = extend_beams([root] * 9, grasps * 3, 5, [lanes] * 9)
    for index in (0, 8):
        (alone,) = extend_beams([root], [grasps[index % 3]], 5, [lanes])
        for ours, theirs in zip(together[index], alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert together[0].violation.shape == (BEAM_WIDTH,)
    (other,) = extend_beams([root], [grasps[0]], 6, [lanes])
    assert (other.q != together[0].q).any()


def test_who_asks_decides_how_many_share_a_call() -> None:
    """And not who else is served with it: the first grasps of one search alone, and beside those of another."""
    few = [transcribe(SCENE, skeleton[:1]) for skeleton in SKELETONS]
    many = few * 2
    assert len(few) == CPU.few
    assert beam_lanes(few) == [1] * CPU.few
    assert beam_lanes(many) == [CPU.beam_lanes] * len(many)
    root = empty_prefix(3, 4)

    def ask(problems: list[Problem]) -> Steps[list[KeyframeBeam]]:
        return (yield Extend([root] * len(problems), problems, 5))

    alone = [run_alone(ask(problems)) for problems in (few, many)]
    for index, beside in run_together([ask(few), ask(many)]):
        for ours, theirs in zip(jax.tree.leaves(beside), jax.tree.leaves(alone[index]), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    for ours, theirs in zip(jax.tree.leaves(alone[0]), jax.tree.leaves(alone[1][: CPU.few]), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)
