"""States, handover and error messages, and the whole grounding against a reference written with plain sets."""

import pickle
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.errors import DvrError
from dvr_jax.logic import (
    Action,
    Grounding,
    LogicError,
    count_sequences,
    ground_actions,
)

ARMS = ("left", "right")
FACES = ("+x", "+y", "-x", "-y")

GRASP_YELLOW = Action("grasp", ("left", "+x", "yellow"))
TAKE_OVER = Action("grasp", ("right", "-y", "yellow"))


@dataclass(frozen=True)
class ReferenceState:
    """Each object stands on "table" or "goal" or is in the hand of an arm: (kind, name) by object."""

    where: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Reference:
    """The rules of the domain once more, without PDDL, grounder or bits."""

    objects: tuple[str, ...]
    goal_object: str
    arms: tuple[str, ...]

    def start(self) -> ReferenceState:
        return ReferenceState((("on", "table"),) * len(self.objects))

    def is_goal(self, state: ReferenceState) -> bool:
        return state.where[self.objects.index(self.goal_object)] == ("on", "goal")

    def steps(self, state: ReferenceState) -> dict[Action, ReferenceState]:
        found = {}
        for arm in self.arms:
            for i, name in enumerate(self.objects):
                if ("in", arm) not in state.where:
                    for face in FACES:
                        found[Action("grasp", (arm, face, name))] = self.put(state, i, ("in", arm))
                if state.where[i] == ("in", arm):
                    for support in ("table", "goal"):
                        found[Action("place", (arm, name, support))] = self.put(
                            state, i, ("on", support)
                        )
        return found

    def put(self, state: ReferenceState, i: int, place: tuple[str, str]) -> ReferenceState:
        return ReferenceState((*state.where[:i], place, *state.where[i + 1 :]))

    def facts(self, state: ReferenceState) -> set[tuple[str, ...]]:
        return {
            ("on", name, at) if kind == "on" else ("holding", at, name)
            for name, (kind, at) in zip(self.objects, state.where, strict=True)
        }

    def sequences(self, state: ReferenceState, length: int) -> Iterator[tuple[Action, ...]]:
        if self.is_goal(state) or length == 0:
            if self.is_goal(state) and length == 0:
                yield ()
            return
        for action, after in self.steps(state).items():
            for rest in self.sequences(after, length - 1):
                yield (action, *rest)


@st.composite
def references(draw: st.DrawFn, most_objects: int = 5) -> Reference:
    names = st.sampled_from(
        [
            "table",
            "goal",
            "left",
            "right",
            "+x",
            "o0",
            "on",
            "face0",
            "a b",
            "(x)",
            "Ä",
            "?o",
            "YELLOW",
        ]
    )
    objects = tuple(draw(st.lists(names, min_size=1, max_size=most_objects, unique=True)))
    arms = tuple(
        draw(
            st.lists(
                st.sampled_from(["left", "right", "third", "table"]),
                min_size=1,
                max_size=3,
                unique=True,
            )
        )
    )
    return Reference(objects, draw(st.sampled_from(objects)), arms)


def ground(reference: Reference) -> Grounding:
    return ground_actions(reference.objects, reference.goal_object, reference.arms)


@given(references(), st.data())
@settings(max_examples=150, deadline=None)
def test_random_walks_agree_with_the_reference(reference: Reference, data: st.DataObject) -> None:
    grounding = ground(reference)
    state, expected = grounding.initial_state, reference.start()
    for _ in range(data.draw(st.integers(1, 15), label="steps")):
        steps = reference.steps(expected)
        indices = grounding.applicable(state)
        assert {grounding.actions[index] for index in indices} == set(steps)
        assert list(indices) == sorted(indices)
        assert set(grounding.facts_in(state)) == reference.facts(expected)
        assert all(
            grounding.holds(state, *fact) == (fact in reference.facts(expected))
            for fact in grounding.facts
        )
        assert grounding.is_goal(state) == reference.is_goal(expected)
        index = data.draw(st.sampled_from(indices), label="action")
        state, expected = grounding.successor(state, index), steps[grounding.actions[index]]


@given(references(most_objects=2), st.integers(0, 3), st.data())
@settings(max_examples=40, deadline=None)
def test_reaching_the_goal_agrees_with_the_reference(
    reference: Reference, remaining: int, data: st.DataObject
) -> None:
    grounding = ground(reference)
    counts = count_sequences(grounding, 3)
    assert counts == {
        k: sum(1 for _ in reference.sequences(reference.start(), k)) for k in (1, 2, 3)
    }
    state, expected = grounding.initial_state, reference.start()
    for _ in range(data.draw(st.integers(0, 3), label="steps")):
        index = data.draw(st.sampled_from(grounding.applicable(state)), label="action")
        state, expected = (
            grounding.successor(state, index),
            reference.steps(expected)[grounding.actions[index]],
        )
    exact = [any(True for _ in reference.sequences(expected, k)) for k in range(remaining + 1)]
    assert [grounding.reaches_goal_in(state, k) for k in range(remaining + 1)] == exact
    assert grounding.can_reach_goal(state, remaining) == any(exact)
    assert not grounding.can_reach_goal(state, -1)


def test_handover_empties_the_giving_hand() -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS)
    start, held, taken = grounding.apply([GRASP_YELLOW, TAKE_OVER])
    assert grounding.facts_in(start) == (("on", "yellow", "table"), ("on", "red", "table"))
    assert grounding.holds(held, "holding", "left", "yellow") and not grounding.holds(
        held, "on", "yellow", "table"
    )
    assert set(grounding.facts_in(taken)) == {
        ("holding", "right", "yellow"),
        ("on", "red", "table"),
    }
    free_again = Action("grasp", ("left", "+y", "red"))
    assert grounding.index(free_again) in grounding.applicable(taken)
    place = Action("place", ("right", "yellow", "goal"))
    assert len(grounding.check_sequence([GRASP_YELLOW, TAKE_OVER, free_again, place])) == 5


def test_a_full_hand_grasps_nothing_not_even_what_it_holds() -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS)
    held = grounding.apply([GRASP_YELLOW])[-1]
    names = {str(grounding.actions[index]) for index in grounding.applicable(held)}
    assert not any(name.startswith("grasp(left") for name in names)
    assert {"place(left, yellow, goal)", "place(left, yellow, table)"} <= names
    with pytest.raises(LogicError, match=r"grasp\(left, \+x, yellow\) is not applicable"):
        grounding.successor(held, grounding.index(GRASP_YELLOW))


def test_other_objects_may_stand_on_the_goal() -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS)
    sequence = [Action("grasp", ("left", "+x", "red")), Action("place", ("left", "red", "goal"))]
    state = grounding.apply(sequence)[-1]
    assert grounding.holds(state, "on", "red", "goal") and not grounding.is_goal(state)


def test_actions_are_values_in_a_fixed_order() -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS)
    assert grounding == ground_actions(["yellow", "red"], "yellow", ARMS) and hash(grounding)
    assert [str(action) for action in grounding.actions[:4]] == [
        "grasp(left, +x, yellow)",
        "grasp(left, +x, red)",
        "grasp(left, +y, yellow)",
        "grasp(left, +y, red)",
    ]
    assert list(
        dict.fromkeys(a.arguments[1] for a in grounding.actions if a.operator == "grasp")
    ) == list(FACES)
    assert list(dict.fromkeys(a.arguments[0] for a in grounding.actions)) == list(ARMS)
    assert sorted({TAKE_OVER, GRASP_YELLOW}) == [GRASP_YELLOW, TAKE_OVER]
    grounding.can_reach_goal(grounding.initial_state, 3)
    assert pickle.loads(pickle.dumps(grounding)) == grounding


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (
            [GRASP_YELLOW, Action("grasp", ("left", "+y", "red"))],
            "action 2 of 2: grasp(left, +y, red) is not applicable, because holding(left, yellow) holds. "
            "Applicable there: grasp(right, +x, yellow), ",
        ),
        (
            [Action("place", ("right", "red", "goal"))],
            "action 1 of 1: place(right, red, goal) is not applicable, because holding(right, red) does not hold. "
            "Applicable there: grasp(left, +x, yellow), ",
        ),
        (
            [Action("push", ("left",))],
            "action 1 of 1: push(left): there is no operator 'push'; valid: grasp, place.",
        ),
        ([Action("grasp", ("left",))], "grasp takes 3 arguments, as in grasp(left, +x, yellow)."),
        ([Action("grasp", ("left", "+z", "red"))], "argument 2 is '+z'; valid: +x, +y, -x, -y."),
        ([Action("grasp", ("left", "+x", "blue"))], "argument 3 is 'blue'; valid: yellow, red."),
        ([GRASP_YELLOW], "this sequence of length 1 does not reach the goal on(yellow, goal)."),
        ([], "this sequence of length 0 does not reach the goal on(yellow, goal)."),
        (
            [GRASP_YELLOW, Action("place", ("left", "yellow", "goal")), TAKE_OVER],
            "the goal on(yellow, goal) holds after 2 of 3 actions: the sequence must end there.",
        ),
    ],
)
def test_a_wrong_sequence_is_explained(sequence: list[Action], message: str) -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS)
    with pytest.raises(LogicError) as caught:
        grounding.check_sequence(sequence)
    assert message in str(caught.value)
    assert isinstance(caught.value, DvrError) and isinstance(caught.value, ValueError)


def test_an_unknown_fact_is_refused() -> None:
    grounding = ground_actions(["yellow"], "yellow", ARMS)
    with pytest.raises(LogicError, match=r"free\(left\).*valid: holding\(left, yellow\)"):
        grounding.holds(grounding.initial_state, "free", "left")


@pytest.mark.parametrize(
    ("objects", "goal_object", "arms", "message"),
    [
        (
            ["yellow", "red"],
            "blue",
            ARMS,
            "the goal object 'blue' is no object of the scene; objects: yellow, red.",
        ),
        (["yellow", "yellow"], "yellow", ARMS, "two objects have the same name: yellow."),
        ([], "yellow", ARMS, "there is no object; at least one is needed."),
        (
            "yellow",
            "y",
            ARMS,
            "the object names are one string, 'yellow'; wanted is a sequence of names.",
        ),
        (["yellow"], "yellow", ["left", "left"], "two arms have the same name: left."),
    ],
)
def test_bad_names_are_refused(
    objects: list[str], goal_object: str, arms: list[str], message: str
) -> None:
    with pytest.raises(LogicError) as caught:
        ground_actions(objects, goal_object, arms)
    assert str(caught.value) == message
