"""Codes of actions against the actions themselves."""

import pytest

from dvr_jax.errors import DvrError
from dvr_jax.logic import ground_actions
from dvr_jax.logic.grounding import Action, Grounding
from dvr_jax.model.encoding import SYMBOLS, domain_signature, encode_actions, object_pairs


@pytest.mark.parametrize("number", range(1, 9))
def test_symbols_do_not_depend_on_the_number_of_objects(number: int) -> None:
    names = [f"thing {i}" for i in range(number)]
    grounding = ground_actions(names, names[-1])
    codes = encode_actions(grounding, names)
    assert set(codes.symbol) == set(range(12)) and len(codes.symbol) == 12 * number
    assert codes.pairs.shape == (2 * number, 2) and len({tuple(pair) for pair in codes.pairs}) == 2 * number
    assert (
        len({(symbol, *codes.pairs[i]) for symbol, i in zip(codes.symbol, codes.tuple_index, strict=True)})
        == 12 * number
    )


def test_names_that_look_like_supports_and_arms() -> None:
    names = ["table", "left", "goal"]
    grounding = ground_actions(names, "goal")
    codes = encode_actions(grounding, names)
    goal_mask, zeros = 3, 4
    for action, symbol, index in zip(grounding.actions, codes.symbol, codes.tuple_index, strict=True):
        pair = tuple(codes.pairs[index])
        if action.operator == "grasp":
            arm, face, name = action.arguments
            assert SYMBOLS[symbol] == ("grasp", arm, face) and pair == (names.index(name), zeros)
        else:
            arm, name, support = action.arguments
            assert SYMBOLS[symbol] == ("place", arm, support)
            assert pair == (names.index(name), goal_mask if support == "goal" else zeros)


def test_order_of_actions_does_not_depend_on_names_or_goal() -> None:
    one = encode_actions(ground_actions(["a", "b"], "a"), ["a", "b"])
    other = encode_actions(ground_actions(["zebra", "ape"], "ape"), ["zebra", "ape"])
    assert all((mine == theirs).all() for mine, theirs in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (Action("push", ("left", "a")), "no operator 'push'; it knows: grasp, place"),
        (Action("grasp", ("left", "top", "a")), "no grasp 'left top'; it knows: left \\+x"),
        (Action("grasp", ("left", "+x", "b")), "'b' is no object of the scene; objects: a"),
    ],
)
def test_unknown_actions_are_refused(action: Action, message: str) -> None:
    grounding = Grounding((action,), (), (), 0, 0)
    with pytest.raises(DvrError, match=message):
        encode_actions(grounding, ["a"])


def test_signature_follows_rules_but_not_comments() -> None:
    domain = "(define (domain d)\n (:action grasp)) ; a comment"
    assert domain_signature(domain) == domain_signature("(define (domain d) (:action grasp))")
    assert domain_signature(domain) != domain_signature(domain.replace("grasp", "push"))
    assert domain_signature() == domain_signature() and object_pairs(1).tolist() == [[0, 2], [0, 1]]
