"""A phase that is added to a keyframe NLP changes neither its violations nor what its solutions are solutions of."""

import re

import jax
import numpy as np
import pytest
from nlp_cases import SCENE, SKELETONS, violations_of
from solver_cases import MODEL, random_keyframes

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.transcription import transcribe, transcribe_window
from dvr_jax.solver.lane_pool import solve, stack
from dvr_jax.solver.padding import missing_phases, pad_keyframes
from dvr_jax.solver.state import Settings

WINDOW: tuple[Action, ...] = SKELETONS[0][:3]


def _problems() -> dict[str, Problem]:
    """Return keyframe NLPs of one and three phases, and one in which an object is held from the beginning."""
    found = {
        f"{number} actions of skeleton {index}": transcribe(SCENE, skeleton[:number])
        for index, skeleton in enumerate(SKELETONS)
        for number in (1, 3)
    }
    found["window"] = transcribe_window(SCENE, WINDOW[0], WINDOW[1:])
    return found


PROBLEMS = _problems()


def test_even_numbers_of_phases_stay() -> None:
    assert [missing_phases(number) for number in range(1, 7)] == [1, 0, 1, 0, 1, 0]
    problem = transcribe(SCENE, SKELETONS[0][:2])
    start = random_keyframes(problem, np.random.default_rng(0))
    assert pad_keyframes(problem, start) == (problem, start)


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_array_of_phases_or_slices_has_one_more_row(name: str) -> None:
    problem = PROBLEMS[name]
    padded, _ = pad_keyframes(problem, random_keyframes(problem, np.random.default_rng(0)))
    for field, annotation in Problem.__annotations__.items():
        added = int(bool(re.search(r"\*batch (phases|slices)", str(annotation))))
        before = np.shape(getattr(problem, field))
        after = np.shape(getattr(padded, field))
        assert after[1:] == before[1:], field
        assert after[:1] == tuple(size + added for size in before[:1]), field


@pytest.mark.parametrize("name", PROBLEMS)
def test_violations_are_those_of_the_nlp(name: str) -> None:
    problem = PROBLEMS[name]
    generator = np.random.default_rng(1)
    for _ in range(4):
        start = random_keyframes(problem, generator)
        padded, longer = pad_keyframes(problem, start)
        assert len(longer.q) == len(start.q) + 1
        expected = violations_of(MODEL, stack([problem]), stack([start]))
        found = violations_of(MODEL, stack([padded]), stack([longer]))
        assert expected.keys() == found.keys()
        for measure, value in expected.items():
            np.testing.assert_allclose(found[measure], value, atol=1e-9, err_msg=measure)


@pytest.mark.parametrize("name", ["1 actions of skeleton 0", "3 actions of skeleton 1", "window"])
def test_solutions_are_solutions_of_the_nlp(name: str) -> None:
    problem = PROBLEMS[name]
    generator = np.random.default_rng(2)
    starts = [random_keyframes(problem, generator) for _ in range(40)]
    with jax.enable_x64(True):
        solutions = solve(MODEL, [problem] * len(starts), starts, Settings())
    # A random start seldom leads to keyframes of several actions.
    if name.startswith("1"):
        assert any(solution.feasible for solution in solutions)

    for solution in solutions:
        assert solution.q.shape == starts[0].q.shape
        assert solution.m.shape == starts[0].m.shape
        point = stack([Variables(solution.q, solution.m)])
        violations = violations_of(MODEL, stack([problem]), point)
        for measure, value in solution.violations.items():
            np.testing.assert_allclose(violations[measure][0], value, atol=1e-9, err_msg=measure)
