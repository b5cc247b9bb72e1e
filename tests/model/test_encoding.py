"""Codes of actions against the actions themselves."""

import math

import numpy as np
import pytest

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, Grounding, ground_actions
from dvr_jax.model.encoding import (
    SYMBOLS,
    TRAINED_ARMS,
    actions_per_object,
    direction,
    encode_actions,
    input_signature,
    object_pairs,
    tuples_per_object,
)
from dvr_jax.scene.types import SceneObject


def boxes(*names: str, yaw: float = 0.0) -> list[SceneObject]:
    return [SceneObject(name, "box", (0.05, 0.1, 0.1), (0.0, 0.0), yaw) for name in names]


@pytest.mark.parametrize("number", range(1, 9))
def test_symbols_do_not_depend_on_the_number_of_objects(number: int) -> None:
    names = [f"thing {i}" for i in range(number)]
    grounding = ground_actions(names, names[-1], TRAINED_ARMS)
    codes = encode_actions(grounding, boxes(*names))
    assert set(codes.symbol) == set(range(12)) and len(codes.symbol) == 12 * number
    assert (actions_per_object(), tuples_per_object()) == (12, 2)
    assert (
        codes.pairs.shape == (2 * number, 2)
        and len({tuple(pair) for pair in codes.pairs}) == 2 * number
    )
    assert (
        len(
            {
                (symbol, *codes.pairs[i])
                for symbol, i in zip(codes.symbol, codes.tuple_index, strict=True)
            }
        )
        == 12 * number
    )


def test_names_that_look_like_supports_and_arms() -> None:
    names = ["table", "left", "goal"]
    grounding = ground_actions(names, "goal", TRAINED_ARMS)
    codes = encode_actions(grounding, boxes(*names))
    goal_mask, zeros = 3, 4
    for action, symbol, index in zip(
        grounding.actions, codes.symbol, codes.tuple_index, strict=True
    ):
        pair = tuple(codes.pairs[index])
        if action.operator == "grasp":
            arm, face, name = action.arguments
            assert SYMBOLS[symbol] == ("grasp", arm, direction(face, boxes(name)[0]))
            assert pair == (names.index(name), zeros)
        else:
            arm, name, support = action.arguments
            assert SYMBOLS[symbol] == ("place", arm, support)
            assert pair == (names.index(name), goal_mask if support == "goal" else zeros)


def test_order_of_actions_does_not_depend_on_names_or_goal() -> None:
    one = encode_actions(ground_actions(["a", "b"], "a", TRAINED_ARMS), boxes("a", "b"))
    other = encode_actions(
        ground_actions(["zebra", "ape"], "ape", TRAINED_ARMS), boxes("zebra", "ape")
    )
    assert all((mine == theirs).all() for mine, theirs in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (Action("push", ("left", "a")), "no operator 'push'; it knows: grasp, place"),
        (Action("grasp", ("left", "top", "a")), r"no grasp \('left', 'top'\); it knows: left east"),
        (Action("grasp", ("left", "+x", "b")), "'b' is no object of the scene; objects: a"),
    ],
)
def test_unknown_actions_are_refused(action: Action, message: str) -> None:
    grounding = Grounding((action,), (), (), 0, 0)
    with pytest.raises(DvrError, match=message):
        encode_actions(grounding, boxes("a"))


def test_faces_look_where_their_normals_point() -> None:
    ends = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}
    for yaw in np.linspace(-7, 7, 57):
        for angle, face in zip((0, 90, 180, 270), ("+x", "+y", "-x", "-y"), strict=True):
            normal = math.cos(yaw + math.radians(angle)), math.sin(yaw + math.radians(angle))
            expected = max(ends, key=lambda name: np.dot(ends[name], normal))
            assert direction(face, boxes("a", yaw=yaw)[0]) == expected


def test_tuples_are_each_object_alone_and_on_the_goal() -> None:
    assert object_pairs(1).tolist() == [[0, 2], [0, 1]]


def test_a_network_is_refused_under_another_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    here = input_signature()
    monkeypatch.setattr("dvr_jax.model.encoding.domain_signature", lambda: "another")
    assert input_signature() != here
