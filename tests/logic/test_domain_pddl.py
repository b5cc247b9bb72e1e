"""Other domains than our own: what the grounder takes, and what it refuses by name."""

import sys

import pytest

from dvr_jax.logic import (
    Action,
    LogicError,
    compose_domain,
    count_sequences,
    domain_signature,
    enumerate_sequences,
    ground_actions,
)
from dvr_jax.logic.domain import shipped_actions, shipped_domain, shipped_header
from dvr_jax.logic.grounder import Entity, ground_domain
from dvr_jax.logic.parsing import parse_domain, read_domain
from dvr_jax.logic.task import ground_task_in, paper_task

ARMS = ("left", "right")

OURS = shipped_domain()

PUSH = """
  (:action push
    :parameters (?arm - arm ?item - movable ?from ?to - support)
    :precondition (and
      (forall (?held - movable) (not (holding ?arm ?held)))
      (on ?item ?from)
      (not (= ?from ?to)))
    :effect (and (not (on ?item ?from)) (on ?item ?to)))"""

ROOMS = """
(define (domain rooms)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions :conditional-effects)
  (:types room vehicle - object  car drone - vehicle)
  (:constants garden - room)
  (:predicates (at ?what - vehicle ?where - room) (door ?from ?to - room) (seen ?where - room) (clean))
  (:action DRIVE
    :parameters (?what - car ?from ?to - room)
    :precondition (and (at ?what ?from) (Door ?from ?to))
    :effect (and (forall (?anywhere - room) (not (at ?what ?anywhere))) (at ?what ?to) (seen ?to)))
  (:action fly
    :parameters (?what - (either drone car) ?to - room)
    :precondition (and (not (at ?what ?to)) (clean))
    :effect (and (forall (?r - room) (not (at ?what ?r))) (at ?what ?to)))
  (:action wait :parameters () :precondition () :effect ())
)"""


def with_precondition(text: str, requirement: str = "") -> str:
    """Our domain, `place` having another precondition."""
    changed = OURS.replace(":precondition (holding ?arm ?item)", f":precondition {text}")
    assert changed != OURS
    return changed.replace(":strips", f":strips {requirement}")


def with_effect(text: str, requirement: str = "") -> str:
    changed = OURS.replace("(on ?item ?support)))\n)", f"{text}))\n)")
    assert changed != OURS
    return changed.replace(":strips", f":strips {requirement}")


def test_an_added_operator_is_grounded() -> None:
    action_texts = [*shipped_actions(), PUSH]
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS, action_texts=action_texts)
    pushes = [action for action in grounding.actions if action.operator == "push"]
    assert len(pushes) == 2 * 2 * 2  # arms, objects, (from, to) with from /= to
    push = Action("push", ("left", "yellow", "table", "goal"))
    grounding.check_sequence([push])
    assert [str(grounding.actions[i]) for (i,) in enumerate_sequences(grounding, 1)] == [
        "push(left, yellow, table, goal)",
        "push(right, yellow, table, goal)",
    ]
    # Length 2: 8 by grasp and place; after each of 8 grasps of red the other arm can push yellow; after each of
    # 2 pushes of red both arms can; after a grasp of yellow nobody can, since it stands nowhere.
    assert count_sequences(grounding, 2) == {1: 2, 2: 8 + 8 * 1 + 2 * 2}


def test_types_constants_and_facts_that_never_change() -> None:
    domain = parse_domain(ROOMS)
    entities = [
        Entity("r0", "room", "hall"),
        Entity("c0", "car", "red"),
        Entity("d0", "drone", "red"),
    ]
    doors = [("door", "garden", "r0"), ("door", "r0", "garden")]
    initial = [("at", "c0", "r0"), ("at", "d0", "garden"), *doors]
    grounding = ground_domain(
        domain, entities[:2], initial[:1] + doors, [("at", "c0", "garden"), doors[0]]
    )
    # `clean` is false for ever: no `fly`. `door` is fixed, so it needs no bit and leaves 2 of 4 (from, to).
    assert list(map(str, grounding.actions)) == [
        "drive(red, garden, hall)",
        "drive(red, hall, garden)",
        "wait()",
    ]
    assert {fact[0] for fact in grounding.facts} == {"at", "seen"}
    assert list(enumerate_sequences(grounding, 2)) == [(2, 1)]
    (_, after) = grounding.check_sequence([Action("drive", ("red", "hall", "garden"))])
    assert set(grounding.facts_in(after)) == {("at", "red", "garden"), ("seen", "garden")}

    clean = ground_domain(
        domain, [entities[0], entities[2]], [*initial[1:], ("clean",)], [("at", "d0", "r0")]
    )
    assert [str(action) for action in clean.actions if action.operator != "wait"] == [
        "fly(red, garden)",
        "fly(red, hall)",
    ]
    with pytest.raises(LogicError, match="two actions of the domain would both be called fly"):
        ground_domain(domain, entities, [*initial, ("clean",)], [("at", "d0", "r0")])


def test_effects_delete_first_and_add_afterwards() -> None:
    text = """(define (domain d) (:predicates (p) (q))
      (:action renew :parameters () :precondition (p) :effect (and (p) (q) (not (p)))))"""
    grounding = ground_domain(parse_domain(text), [], [("p",)], [("q",)])
    assert grounding.facts_in(grounding.successor(grounding.initial_state, 0)) == (("p",), ("q",))


def test_a_goal_out_of_reach() -> None:
    text = "(define (domain d) (:predicates (p) (q)) (:action a :parameters () :precondition (q) :effect (p)))"
    with pytest.raises(LogicError, match=r"the goal \(q\) can never hold"):
        ground_domain(parse_domain(text), [], [], [("q",)])
    grounding = ground_domain(parse_domain(text), [], [], [("p",)])
    assert grounding.actions == () and not grounding.can_reach_goal(grounding.initial_state, 5)


def test_an_inner_variable_hides_an_outer_one() -> None:
    text = """(define (domain d) (:requirements :typing :universal-preconditions :conditional-effects)
      (:types t) (:predicates (p ?x - t) (q ?x - t))
      (:action a :parameters (?x - t) :precondition (forall (?x - t) (p ?x)) :effect (and (q ?x) (not (p ?x)))))"""
    two = [Entity("x", "t", "x"), Entity("y", "t", "y")]
    grounding = ground_domain(parse_domain(text), two, [("p", "x"), ("p", "y")], [("q", "y")])
    assert grounding.applicable(grounding.initial_state) == (0, 1)
    assert grounding.applicable(grounding.successor(grounding.initial_state, 0)) == ()


@pytest.mark.parametrize(
    ("text", "culprit"),
    [
        (
            with_effect("(when (on ?item table) (on ?item goal))"),
            "`when` (conditional effect) is not supported",
        ),
        (
            with_effect("(oneof (on ?item table) (on ?item goal))", ":non-deterministic"),
            "`oneof` (non-determ",
        ),
        (with_effect("(increase (total-cost) 1)", ":action-costs"), "numeric"),
        (with_effect("(= ?item ?item)"), "`=` in an effect is not supported"),
        (
            with_precondition(
                "(or (holding ?arm ?item) (on ?item table))", ":disjunctive-preconditions"
            ),
            "`or` is not",
        ),
        (
            with_precondition("(imply (on ?item goal) (on ?item table))", ":adl"),
            "`imply` is not supported",
        ),
        (
            with_precondition("(exists (?x - movable) (holding ?arm ?x))", ":adl"),
            "`exists` is not supported",
        ),
        (
            with_precondition("(not (and (on ?item goal) (on ?item table)))"),
            "`not` of anything but a fact is not",
        ),
        (
            with_precondition("(not (forall (?x - movable) (on ?x table)))"),
            "`not` of anything but a fact is not",
        ),
        (
            OURS.replace(
                "(:action grasp",
                "(:derived (on ?i - movable ?s - support) (on ?i table)) (:action grasp",
            ),
            ":derived",
        ),
        (
            OURS.replace("(:action grasp", "(:functions (cost)) (:action grasp", 1),
            "numeric fluents",
        ),
    ],
)
def test_unsupported_constructs_are_refused_by_name(text: str, culprit: str) -> None:
    assert text != OURS
    with pytest.raises(LogicError) as caught:
        parse_domain(text, "mine.pddl")
    assert str(caught.value).startswith("mine.pddl") and culprit in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            with_precondition("(holdng ?arm ?item)"),
            "(holdng ?arm ?item): no such predicate; declared: holding, on.",
        ),
        (
            with_precondition("(holding ?arm)"),
            "operator 'place', (holding ?arm): 'holding' takes 2 terms.",
        ),
        (with_precondition("(holding ?arm ?itm)"), "'?itm' is not declared; known here: face0, "),
        (with_precondition("(holding ?arm tabel)"), "Constant 'tabel' not defined"),
        (
            with_precondition("(holding ?item ?arm)"),
            "'?item' is of type movable, wanted here: arm.",
        ),
        (
            with_precondition("(holding ?arm table)"),
            "'table' is of type support, wanted here: movable.",
        ),
        (OURS.replace("?support - support)\n", "?support - suport)\n"), "suport"),
        (OURS.replace("(:action grasp", "(:action place"), "two operators are named 'place'."),
        (OURS.rstrip().removesuffix(")"), "is not a PDDL domain that can be read"),
        ("", "is not a PDDL domain that can be read"),
    ],
)
def test_mistakes_are_named(text: str, message: str) -> None:
    with pytest.raises(LogicError) as caught:
        parse_domain(text, "mine.pddl")
    assert str(caught.value).startswith("mine.pddl") and message in str(caught.value)
    assert not hasattr(sys, "tracebacklimit")  # the library would leave it at 0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "movable",
            "thing",
            "'yellow' is of type 'movable', which domain 'deep-visual-reasoning' does not declare",
        ),
        (" goal ", " shelf ", "'goal' does not fit into (on o0 goal)"),
        ("(on ", "(upon ", "declares no predicate for (on o0 table)"),
        ("face0", "o0", "the name 'o0' is given twice, or the domain has a constant of that name."),
    ],
)
def test_a_domain_that_does_not_fit_the_task(old: str, new: str, message: str) -> None:
    domain = parse_domain(OURS.replace(old, new))
    with pytest.raises(LogicError) as caught:
        ground_task_in(domain, paper_task(["yellow"], "yellow", ARMS))
    assert message in str(caught.value)


def test_a_domain_is_parsed_once() -> None:
    assert read_domain() is read_domain()
    assert read_domain(list(shipped_actions())) is read_domain()


def test_the_signature_of_grasp_and_place_is_that_of_all_shipped_labels_and_networks() -> None:
    assert domain_signature() == "4bb93edc68665597"
    assert (
        domain_signature(compose_domain(shipped_header(), shipped_actions())) == "4bb93edc68665597"
    )
    assert (
        domain_signature(compose_domain(shipped_header(), shipped_actions()[::-1]))
        != "4bb93edc68665597"
    )


def test_further_operators_take_the_place_of_the_shipped_ones() -> None:
    grounding = ground_actions(["yellow", "red"], "yellow", ARMS, action_texts=[PUSH])
    assert {action.operator for action in grounding.actions} == {"push"}
    assert {
        action.operator for action in ground_actions(["yellow", "red"], "yellow", ARMS).actions
    } == {
        "grasp",
        "place",
    }


@pytest.mark.parametrize(
    "header",
    [
        "(define (domain d) (:predicates (p) (q)))",
        "(define (domain d) (:predicates (p) (q))\n) ; a comment (with parentheses)\n",
        "; (one more)\n(define (domain d) ; )\n (:predicates (p) (q)))\n\n",
    ],
)
def test_actions_are_inserted_before_the_last_parenthesis_outside_comments(header: str) -> None:
    renew = "(:action renew :parameters () :precondition (p) :effect (q)) ; without end )"
    undo = "; undo\n(:action undo :parameters () :precondition (q) :effect (not (q)))\n"
    domain = parse_domain(compose_domain(header, [renew, undo]))
    assert [action.name for action in domain.actions] == ["renew", "undo"]
    assert [predicate.name for predicate in domain.predicates] == ["p", "q"]
    assert parse_domain(compose_domain(header, [])).actions == ()


def test_a_header_without_end_is_refused() -> None:
    with pytest.raises(LogicError, match="the header of the domain has no closing parenthesis"):
        compose_domain("; (define (domain d))", shipped_actions())


def test_a_broken_action_text_is_refused() -> None:
    with pytest.raises(
        LogicError,
        match=r"operator 'push', \(held \?item\): no such predicate; declared: holding, on",
    ):
        ground_actions(
            ["yellow"],
            "yellow",
            ARMS,
            action_texts=[PUSH.replace("(on ?item ?from)\n", "(held ?item)\n")],
        )
    with pytest.raises(LogicError, match="is not a PDDL domain that can be read"):
        ground_actions(["yellow"], "yellow", ARMS, action_texts=["(:action push"])
    with pytest.raises(LogicError, match="two operators are named 'grasp'"):
        ground_actions(
            ["yellow"],
            "yellow",
            ARMS,
            action_texts=[*shipped_actions(), PUSH.replace("push", "grasp")],
        )


def test_signature_follows_rules_but_not_comments_case_or_spacing() -> None:
    domain = "(define (domain d)\n (:action grasp)) ; a comment"
    assert domain_signature(domain) == domain_signature("( define (DOMAIN d) (:action grasp))")
    assert domain_signature(domain) != domain_signature(domain.replace("grasp", "push"))
    assert domain_signature() != domain_signature(domain)
