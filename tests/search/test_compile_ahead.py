"""Compiled beside a search: the programs of the sequence that the search will try, then of what it does try."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Variables
from dvr_jax.operators import OPERATORS
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.search import compile_ahead
from dvr_jax.search.compile_ahead import compiling_ahead
from dvr_jax.search.first_guess import likely_length
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import ExtendBeams, SolveNlps, Steps, run_alone
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import Settings, Termination

SCENE = Scene(
    (
        SceneObject("a", "box", (0.05, 0.05, 0.1), (-0.3, 0.1), 0.3),
        SceneObject("b", "box", (0.05, 0.05, 0.1), (0.3, 0.1), 0.3),
    ),
    OnRegion("a", Region((-0.1, -0.2), 0.2, (0.1, 0.1))),
)
GROUNDING = SequenceTree(SCENE, 4).grounding


@dataclass
class Adviser:
    """A network that finds one sequence promising. The hidden state counts the actions of it that were taken."""

    sequence: tuple[Action, ...]
    kind: str = "dvr"

    def render(self, scene: Scene) -> None:
        return None

    def encode_scene(self, scene: Scene, *_: object) -> "Adviser":
        return self

    def initial_hidden(self) -> np.ndarray:
        return np.zeros((1, 1))

    def predict(
        self, encoding: "Adviser", hidden: np.ndarray, actions: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        taken = int(hidden[0, 0])
        wanted = [
            0 <= taken < len(self.sequence) and GROUNDING.actions[index] == self.sequence[taken]
            for index in actions
        ]
        after = [[taken + 1.0] if is_wanted else [-1.0] for is_wanted in wanted]
        return np.where(wanted, 0.9, 0.05), np.array(after)


@pytest.mark.parametrize(
    "texts",
    [
        ("grasp(left, +x, a)", "place(left, a, goal)"),
        ("grasp(left, +x, a)", "grasp(right, +y, a)", "place(right, a, goal)"),
        ("grasp(right, +x, b)", "place(right, b, table)", "grasp(left, +x, a)", "place(left, a, goal)"),
    ],
)  # fmt: skip
def test_the_length_is_that_of_the_sequence_that_the_search_tries_first(
    texts: tuple[str, ...],
) -> None:
    adviser: Any = Adviser(tuple(map(Action.parse, texts)))
    assert likely_length(SCENE, 4, adviser, OPERATORS) == len(texts)


def request_of(slices: int, phases: int, settings: Settings | SequentialSettings) -> SolveNlps:
    """Return a request to solve one NLP of this shape."""
    start = Variables(np.zeros((slices, 14)), np.zeros((phases, 4)))
    return SolveNlps(None, [None], [start], settings)  # type: ignore[arg-type,list-item]


def test_requests_pass_unchanged_and_correct_the_length(monkeypatch: pytest.MonkeyPatch) -> None:
    requests: list[Any] = [
        ExtendBeams(None, ["one"], 0),  # type: ignore[arg-type,list-item]
        request_of(2, 2, Settings()),
        ExtendBeams(None, ["one", "two"], 0),  # type: ignore[arg-type,list-item]
        request_of(30, 3, Settings()),
        request_of(30, 3, SequentialSettings()),
    ]
    lengths = []

    def search(helpers: Any) -> Steps[str]:
        for request in requests:
            assert (yield request) == [id(request)]
            lengths.append((helpers._length, [job.length for job in helpers._soon]))
        return "found"

    helpers = compile_ahead._Helpers(SCENE, 4, None, OPERATORS, Termination.OPTIMAL)
    helpers._length = 2
    helpers._soon = compile_ahead._jobs_of_length(2, is_optimal=True)
    steps = helpers.watch(search(helpers))
    request = next(steps)
    for expected in requests[1:]:
        assert steps.send([id(request)]) is expected  # type: ignore[arg-type]
        request = expected
    with pytest.raises(StopIteration) as stop:
        steps.send([id(request)])  # type: ignore[arg-type]
    assert stop.value.value == "found"

    # The guess holds until several sequences are judged at a time; the path that is solved is no guess.
    beam_and_keyframes = [1, 2]
    assert lengths == [
        (2, [1, 2, 2, 2]),
        (2, [1, 2, 2, 2]),
        (None, beam_and_keyframes),
        (3, [3, *beam_and_keyframes]),
        (3, [3, *beam_and_keyframes]),
    ]


def test_the_lower_bound_is_the_next_guess() -> None:
    """Once it is final: the keyframes that are not judged yet, then the path and its optimum."""
    tree = SequenceTree(SCENE, 6)
    several: Any = ExtendBeams(None, ["one", "two"], 0)  # type: ignore[arg-type,list-item]
    helpers = compile_ahead._Helpers(
        SCENE, 6, None, OPERATORS, Termination.OPTIMAL, tree.relaxation
    )
    helpers._length = 3
    helpers._soon = compile_ahead._jobs_of_length(3, is_optimal=True)

    tree.relaxation.lower_bound = 5
    helpers._learn(several)
    assert helpers._length is None
    assert not any(job.is_of_path for job in helpers._soon)

    tree.relaxation.is_computed = True
    helpers._soon.clear()
    helpers._learn(request_of(3, 3, Settings()))
    helpers._learn(several)
    kinds = compile_ahead._JobKind
    expected = [(kinds.KEYFRAMES, 4), (kinds.KEYFRAMES, 5), (kinds.PATH, 5), (kinds.OPTIMUM, 5)]
    assert helpers._length == 5
    assert [(job.kind, job.length) for job in helpers._soon] == expected
    assert all(map(helpers._is_sure, helpers._soon))


@pytest.mark.parametrize("bound", [1, 7])
def test_a_lower_bound_that_no_plan_can_have_is_no_guess(bound: int) -> None:
    tree = SequenceTree(SCENE, 6)
    tree.relaxation.lower_bound = bound
    tree.relaxation.is_computed = True
    helpers = compile_ahead._Helpers(
        SCENE, 6, None, OPERATORS, Termination.OPTIMAL, tree.relaxation
    )
    assert helpers._needed_actions() is None


def test_nothing_is_done_where_nothing_is_compiled() -> None:
    def search() -> Steps[int]:
        return 7
        yield

    before = threading.active_count()
    with compiling_ahead(SCENE, 4, None, OPERATORS, Termination.OPTIMAL) as watch:
        assert run_alone(watch(search())) == 7
        assert threading.active_count() == before
