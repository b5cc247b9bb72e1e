"""Algorithm 1 finds a solution whenever there is one, whatever the network says (the paper's proposition)."""

from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dvr_jax.logic import Action, enumerate_sequences
from dvr_jax.scene.types import Goal, Region, Scene, SceneObject
from dvr_jax.search.node import Node
from dvr_jax.search.reasoning import LARGEST_BATCH
from dvr_jax.search.run import EXHAUSTED, SOLVED, Outcome, Run
from dvr_jax.search.searches import steps_of
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone

K_MAX = 4
SCENE = Scene(
    (
        SceneObject("a", "box", (0.05, 0.05, 0.1), (-0.3, 0.1), 0.3),
        SceneObject("b", "box", (0.05, 0.05, 0.1), (0.3, 0.1), 0.3),
    ),
    Goal("a", Region((-0.1, -0.2), 0.2, (0.1, 0.1))),
)
GROUNDING = SequenceTree(SCENE, K_MAX).grounding
SEQUENCES = [
    tuple(GROUNDING.actions[index] for index in sequence)
    for length in range(2, K_MAX + 1)
    for sequence in enumerate_sequences(GROUNDING, length)
]


class Oracle(SequenceTree):
    """A tree whose bounds know which sequences are feasible, in the place of geometry: a prefix is feasible if some
    sequence of ``possible`` begins with it, and the path of one of these exists if it is in ``solvable``."""

    def __init__(self, possible: Iterable[tuple[Action, ...]], solvable: Iterable[tuple[Action, ...]]) -> None:
        super().__init__(SCENE, K_MAX)
        self.prefixes = {sequence[:k] for sequence in possible for k in range(len(sequence) + 1)}
        self.solvable = set(solvable)

    def judge_sequences(self, nodes: list[Node]) -> Steps[None]:
        for node in nodes:
            node.feasible = node.actions in self.prefixes
        return
        yield

    def judge_poses(self, nodes: list[Node]) -> Steps[list[bool]]:
        return [True] * len(nodes)
        yield

    def recall_pose(self, node: Node) -> bool:
        return True


class OracleRun(Run):
    """Paths by the oracle."""

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        for leaf in leaves:
            if leaf.actions in self.tree.solvable:
                return Outcome(SOLVED, leaf, None)
        return None
        yield


class Guess:
    """A network that says whatever a function of prefix number and action says."""

    def __init__(self, guess) -> None:
        self.guess = guess

    def look(self, scene) -> str:
        return "image"

    def begin(self, scene, grounding=None, images=None) -> "Guess":
        assert images == "image"
        return self

    def initial_hidden(self, number: int = 1) -> NDArray[np.float32]:
        return np.zeros((number, 1), np.float32)

    def step(self, code, hidden: NDArray[np.float32], actions: Sequence[int]):
        after = (hidden.astype(int) * 37 + np.asarray(actions)[:, None] + 1) % 8388593
        return np.array([self.guess(int(state[0])) for state in after], np.float32), after.astype(np.float32)


GUESSES = {
    "constant 0": lambda state: 0.0,
    "constant 1": lambda state: 1.0,
    "random": lambda state: float(np.random.default_rng(state).random()),
    "nearly never": lambda state: 1e-30 * (state % 7),
}


def solve(search: str, tree: Oracle, network: Guess | None = None) -> Outcome:
    run = OracleRun(tree, lambda node, path: True, lambda line: None)
    return run_alone(steps_of(search, run, network))


@st.composite
def verdicts(draw) -> tuple[list[tuple[Action, ...]], list[tuple[Action, ...]]]:
    possible = draw(st.lists(st.sampled_from(SEQUENCES), max_size=5, unique=True))
    return possible, [sequence for sequence in possible if draw(st.booleans())]


@pytest.mark.parametrize("search", ["dvr", "classifier"])
@pytest.mark.parametrize("guess", GUESSES)
@settings(max_examples=15, deadline=None)
@given(verdicts())
def test_it_solves_what_breadth_first_search_solves(search: str, guess: str, verdict) -> None:
    possible, solvable = verdict
    expected = solve("bfs", Oracle(possible, solvable)).status
    found = solve(search, Oracle(possible, solvable), Guess(GUESSES[guess]))
    assert found.status == expected == (SOLVED if solvable else EXHAUSTED)
    assert found.node is None or found.node.actions in solvable


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(SEQUENCES), st.booleans())
def test_a_network_that_knows_needs_one_path_and_one_that_lies_still_finds_it(solution, lies: bool) -> None:
    tree = Oracle([solution], [solution])
    states = {0: 1.0}
    state = 0
    for action in solution:
        state = (state * 37 + tree.grounding.index(action) + 1) % 8388593
        states[state] = 1.0
    guess = Guess(lambda state: states.get(state, 0.0) if not lies else 1 - states.get(state, 0.0))
    tried: list[list[Node]] = []

    class Counting(OracleRun):
        def judge_lines(self, leaves):
            tried.append(leaves)
            return (yield from super().judge_lines(leaves))

    outcome = run_alone(steps_of("dvr", Counting(tree, lambda node, path: True, lambda line: None), guess))
    assert outcome.node is not None and outcome.node.actions == solution
    # Alone at first, then in growing batches: a network that lies costs some of them, not one for each sequence.
    assert len(tried[0]) == 1 and len(tried) <= 4 + len(SEQUENCES) / LARGEST_BATCH
    assert lies or tried == [[outcome.node]]
