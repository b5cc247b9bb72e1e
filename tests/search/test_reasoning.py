"""Algorithm 1 expands and tries what the network says, in that order, and finds a solution whenever there is one,
whatever the network says (the paper's proposition)."""

from collections.abc import Callable, Iterable, Sequence
from itertools import count

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dvr_jax.logic import Action, Grounding, enumerate_sequences
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.search.node import Node
from dvr_jax.search.reasoning import DISCOUNT, GROWTH, LARGEST_BATCH, PATIENCE, THRESHOLD
from dvr_jax.search.searches import steps_of
from dvr_jax.search.session import Outcome, SearchSession
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_alone

K_MAX = 4
SCENE = Scene(
    (
        SceneObject("a", "box", (0.05, 0.05, 0.1), (-0.3, 0.1), 0.3),
        SceneObject("b", "box", (0.05, 0.05, 0.1), (0.3, 0.1), 0.3),
    ),
    OnRegion("a", Region((-0.1, -0.2), 0.2, (0.1, 0.1))),
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

    def __init__(
        self, possible: Iterable[tuple[Action, ...]], solvable: Iterable[tuple[Action, ...]]
    ) -> None:
        super().__init__(SCENE, K_MAX, is_relaxed=False)
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

    def check_cached_pose_bound(self, node: Node) -> bool:
        return True


class OracleSession(SearchSession):
    """Paths by the oracle."""

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        for leaf in leaves:
            if leaf.actions in self.tree.solvable:
                return Outcome(PlanStatus.SOLVED, leaf, None)
        return None
        yield


class Guess:
    """A network that says whatever a function of prefix number and action says."""

    def __init__(self, guess) -> None:
        self.guess = guess

    def render(self, scene) -> str:
        return "image"

    def encode_scene(self, scene, grounding=None, images=None) -> "Guess":
        assert images == "image"
        return self

    def initial_hidden(self, number: int = 1) -> NDArray[np.float32]:
        return np.zeros((number, 1), np.float32)

    def predict(self, encoding, hidden: NDArray[np.float32], actions: Sequence[int]):
        after = (hidden.astype(int) * 37 + np.asarray(actions)[:, None] + 1) % 8388593
        return np.array([self.guess(int(state[0])) for state in after], np.float32), after.astype(
            np.float32
        )


GUESSES = {
    "constant 0": lambda state: 0.0,
    "constant 1": lambda state: 1.0,
    "random": lambda state: float(np.random.default_rng(state).random()),
    "nearly never": lambda state: 1e-30 * (state % 7),
}


def solve(search: str, tree: Oracle, network: Guess | None = None) -> Outcome:
    session = OracleSession(tree, lambda node, path: True, lambda line: None)
    return run_alone(steps_of(search, session, network))


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
    assert found.status == expected == (PlanStatus.SOLVED if solvable else PlanStatus.EXHAUSTED)
    assert found.node is None or found.node.actions in solvable


class RelaxedOracle(Oracle):
    """An oracle with a relaxation that refutes nothing, so that the best-first search goes on beside the network's."""

    def __init__(self, solution: tuple[Action, ...]) -> None:
        super().__init__([solution], [solution])
        self.is_relaxed = True
        self.relaxation.lower_bound = len(solution)
        self.expanded = 0

    def judge_scene(self) -> Steps[bool]:
        return True
        yield

    def judge_windows(self, nodes: list[Node], least: int = 1) -> Steps[list[bool]]:
        return [True] * len(nodes)
        yield

    def expand(self, node: Node) -> list[Node]:
        self.expanded += 1
        return super().expand(node)


def test_a_network_that_proposes_nothing_is_not_awaited() -> None:
    """With equal predictions for all nodes, all prefixes would be expanded before the first leaf is tried."""
    solution = max(SEQUENCES, key=len)
    tree = RelaxedOracle(solution)
    found = solve("dvr", tree, Guess(GUESSES["constant 0"]))
    assert found.status == PlanStatus.SOLVED
    assert found.node is not None
    assert found.node.actions == solution
    assert PATIENCE < tree.expanded < 2 * PATIENCE
    assert len({sequence[:-1] for sequence in SEQUENCES}) > 5 * PATIENCE


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(SEQUENCES), st.booleans())
def test_a_network_that_knows_needs_one_path_and_one_that_lies_still_finds_it(
    solution, lies: bool
) -> None:
    tree = Oracle([solution], [solution])
    states = {0: 1.0}
    state = 0
    for action in solution:
        state = (state * 37 + tree.grounding.index(action) + 1) % 8388593
        states[state] = 1.0
    guess = Guess(lambda state: states.get(state, 0.0) if not lies else 1 - states.get(state, 0.0))
    tried: list[list[Node]] = []

    class Counting(OracleSession):
        def judge_prefix_chains(self, leaves):
            tried.append(leaves)
            return (yield from super().judge_prefix_chains(leaves))

    outcome = run_alone(
        steps_of("dvr", Counting(tree, lambda node, path: True, lambda line: None), guess)
    )
    assert outcome.node is not None and outcome.node.actions == solution
    # Alone at first, then in growing batches: a network that lies costs some of them, not one for each sequence.
    assert len(tried[0]) == 1 and len(tried) <= 4 + len(SEQUENCES) / LARGEST_BATCH
    assert lies or tried == [[outcome.node]]


class Script:
    """A network that knows the probability of each prefix, by its actions; and what it was asked, in order."""

    def __init__(self, guess: Callable[[tuple[Action, ...]], float]) -> None:
        self.guess = guess
        self.prefixes: list[tuple[Action, ...]] = [()]
        self.asked: list[tuple[Action, ...]] = []

    def render(self, scene: Scene) -> str:
        return "image"

    def encode_scene(self, scene: Scene, grounding: Grounding, images: str) -> "Script":
        return self

    def initial_hidden(self) -> NDArray[np.float32]:
        return np.zeros((1, 1), np.float32)

    def predict(self, encoding: "Script", hidden: NDArray[np.float32], actions: Sequence[int]):
        prefix = self.prefixes[int(hidden[0, 0])]
        self.asked.append(prefix)
        children = [(*prefix, GROUNDING.actions[index]) for index in actions]
        after = np.arange(len(children)) + len(self.prefixes)
        self.prefixes += children
        return np.array([self.guess(child) for child in children], np.float32), after[
            :, None
        ].astype(np.float32)


def follow(
    search: str, tree: Oracle, script: Script
) -> tuple[Outcome, list[list[tuple[Action, ...]]]]:
    """How a search ends, and the sequences that it tries alone or together, in order."""
    tried: list[list[tuple[Action, ...]]] = []

    class Watched(OracleSession):
        def judge_prefix_chains(self, leaves):
            tried.append([leaf.actions for leaf in leaves])
            return (yield from super().judge_prefix_chains(leaves))

        def judge_leaves(self, leaves):
            before = len(tried)
            passed = yield from super().judge_leaves(leaves)
            tried[before:] = [[leaf.actions for leaf in leaves]]  # and not what it does in turn
            return passed

    return run_alone(
        steps_of(search, Watched(tree, lambda node, path: True, lambda line: None), script)
    ), tried


def reaches_goal(actions: tuple[Action, ...]) -> bool:
    return actions[-1] == Action("place", (actions[-1].arguments[0], "a", "goal"))


LEFT, RIGHT = (
    tuple(map(Action.parse, (f"grasp({arm}, +x, a)", f"place({arm}, a, goal)")))
    for arm in ("left", "right")
)
AWAY = Action.parse("grasp(right, +x, b)")


def test_the_most_promising_node_is_expanded_first() -> None:
    """Predictions 0.9, 0.8 and 0.7 of first actions, 0.85 after the last of them: in this order, none else."""
    deep = (AWAY, LEFT[0])
    values = {LEFT[:1]: 0.8, RIGHT[:1]: 0.7, (AWAY,): 0.9, deep: 0.85, RIGHT: 0.6}
    script = Script(lambda actions: values.get(actions, 0.01))
    outcome, tried = follow("dvr", Oracle([RIGHT], [RIGHT]), script)
    assert outcome.node is not None and outcome.node.actions == RIGHT
    assert script.asked == [(), (AWAY,), deep, LEFT[:1], RIGHT[:1]]
    assert tried == [[RIGHT]]


def test_a_refuted_prefix_is_not_expanded() -> None:
    """The pose bound of a promising grasp fails before the network is asked about what follows it."""

    class Refuting(Oracle):
        def check_cached_pose_bound(self, node: Node) -> bool:
            return node.actions[0] != AWAY

    script = Script(lambda actions: {(AWAY,): 0.9, RIGHT[:1]: 0.7, RIGHT: 0.6}.get(actions, 0.01))
    follow("dvr", Refuting([RIGHT], [RIGHT]), script)
    assert script.asked == [(), RIGHT[:1]]


def test_the_threshold_falls_until_the_best_leaf_exceeds_it() -> None:
    """A leaf of 0.3 is known after two expansions and waits for as many as a threshold of 0.5 needs to fall below."""
    values = {RIGHT[:1]: 0.9, RIGHT: 0.3, LEFT[:1]: 0.8, LEFT: 0.1}
    script = Script(lambda actions: values.get(actions, 0.005 if reaches_goal(actions) else 0.01))
    outcome, tried = follow("dvr", Oracle([RIGHT], [RIGHT]), script)
    assert tried == [[RIGHT]] and outcome.node is not None
    # It is looked at once an expansion; that of RIGHT's grasp is the first at which there is a leaf.
    falls = next(n for n in count() if THRESHOLD * DISCOUNT**n < 0.3)
    assert script.asked[:3] == [(), RIGHT[:1], LEFT[:1]] and len(script.asked) == 2 + falls


def test_leaves_are_tried_from_the_best_on_and_in_growing_batches() -> None:
    order = {
        sequence: 0.99 * (1 - number / len(SEQUENCES))
        for number, sequence in enumerate(reversed(SEQUENCES))
    }
    script = Script(lambda actions: order.get(actions, 0.995))
    outcome, tried = follow("dvr", Oracle(SEQUENCES, []), script)
    assert outcome.status == PlanStatus.EXHAUSTED
    assert {sequence for batch in tried for sequence in batch} == set(SEQUENCES)
    assert [len(batch) for batch in tried][:4] == [1, GROWTH, GROWTH**2, LARGEST_BATCH]
    for batch in tried:
        assert batch == sorted(batch, key=order.__getitem__, reverse=True)


def test_the_classifier_is_breadth_first_among_what_it_calls_feasible() -> None:
    """A deep node of 0.9 waits for the shorter ones of 0.6, and those below the threshold for all above it."""
    values = {LEFT[:1]: 0.6, RIGHT[:1]: 0.55, (AWAY,): 0.9, (AWAY, LEFT[0]): 0.95, RIGHT: 0.6}
    script = Script(lambda actions: values.get(actions, 0.01))
    outcome, tried = follow("classifier", Oracle([RIGHT], [RIGHT]), script)
    assert outcome.node is not None and tried == [[RIGHT]]
    assert script.asked == [(), (AWAY,), LEFT[:1], RIGHT[:1]]
