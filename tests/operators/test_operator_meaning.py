"""Operators as values: arguments by kind, words, duplicates, and what an unknown one says."""

import pytest
from scene_cases import SCENE, grasp, place

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import (
    GRASP,
    OPERATORS,
    PLACE,
    ObjectMode,
    Parameter,
    SkeletonState,
    describe,
    ground_scene,
    is_duplicate,
    object_of,
    operator_of,
)

ACTIONS = (grasp("left", "-x", "can"), place("right", "yellow", "goal"))


def test_arguments_by_their_kind() -> None:
    first, second = ACTIONS
    assert GRASP.argument(first, Parameter.ARM) == "left"
    assert GRASP.argument(first, Parameter.FACE) == "-x"
    assert GRASP.argument(first, Parameter.OBJECT) == "can"
    assert PLACE.argument(second, Parameter.SUPPORT) == "goal"
    assert [object_of(action, OPERATORS) for action in ACTIONS] == ["can", "yellow"]
    with pytest.raises(DvrError, match="'place' has no parameter of the kind 'face'"):
        PLACE.argument(second, Parameter.FACE)


def test_every_operator_has_one_arm_and_one_object() -> None:
    for operator in OPERATORS:
        assert (
            operator.parameters.count(Parameter.ARM)
            == operator.parameters.count(Parameter.OBJECT)
            == 1
        )
    assert len({operator.name for operator in OPERATORS}) == len(OPERATORS)


def test_operators_of_actions() -> None:
    assert [operator_of(action, OPERATORS) for action in ACTIONS] == [GRASP, PLACE]
    with pytest.raises(DvrError, match="'push' has no geometric meaning; known: grasp, place"):
        operator_of(Action("push", ("left",)), OPERATORS)


def test_actions_in_words() -> None:
    described = [describe(action, OPERATORS) for action in ACTIONS]
    assert described == ["left grasps can at its -x face", "right places yellow on goal"]
    unknown = Action("push", ("left", "can"))
    assert describe(unknown, OPERATORS) == str(unknown)


@pytest.mark.parametrize(("item", "faces"), [("yellow", []), ("can", ["+y", "-x", "-y"])])
def test_faces_that_cannot_be_told_apart_are_duplicates(item: str, faces: list[str]) -> None:
    found = [
        face
        for face in ("+x", "+y", "-x", "-y")
        if is_duplicate(SCENE, grasp("left", face, item), OPERATORS)
    ]
    assert found == faces
    assert not is_duplicate(SCENE, place("left", item, "table"), OPERATORS)


def test_actions_of_a_scene_are_those_of_its_operators() -> None:
    """Every grounded action has an operator, whose switch leaves its object in the mode that the operator says."""
    actions = ground_scene(SCENE).actions
    # 2 arms, 4 faces and 3 objects; 2 arms, 3 objects and 2 supports.
    assert len(actions) == 2 * 4 * 3 + 2 * 3 * 2
    standing = tuple(ObjectMode(ModeKind.FIXED) for _ in SCENE.objects)
    state = SkeletonState(SCENE, standing, (0.04, 0.04))
    for action in actions:
        operator = operator_of(action, OPERATORS)
        switch = operator.switch(state, action)
        assert SCENE.objects[switch.item].name == object_of(action, OPERATORS)
        arm = SCENE.workcell.arm_index(operator.argument(action, Parameter.ARM))
        assert switch.acting_arm == arm and arm in switch.arms_at_rest
        assert switch.mode.kind == operator.mode_after
        assert switch.mode.parent == (arm if operator is GRASP else 0)
        assert (switch.support is not None) == (operator is PLACE)
        assert all(
            low <= high for low, high in zip(switch.lower, switch.upper, strict=True) if high < 1e3
        )


@pytest.mark.parametrize("taker", ["left", "right"])
def test_the_giving_arm_rests_and_opens_its_fingers(taker: str) -> None:
    giver = 1 - SCENE.workcell.arm_index(taker)
    modes = (
        ObjectMode(ModeKind.HELD, giver),
        ObjectMode(ModeKind.FIXED),
        ObjectMode(ModeKind.FIXED),
    )
    opening = (0.025, 0.04) if giver == 0 else (0.04, 0.025)
    switch = GRASP.switch(SkeletonState(SCENE, modes, opening), grasp(taker, "-x", "yellow"))
    assert switch.arms_at_rest == {0, 1}
    expected = (0.04, 0.025) if giver == 0 else (0.025, 0.04)
    assert switch.finger_opening == expected
    assert switch.mode == ObjectMode(ModeKind.HELD, 1 - giver)
