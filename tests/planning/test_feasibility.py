"""Verdicts on given sequences: those of a sweep, whatever else is asked; what the logic forbids is named."""

import math
from dataclasses import replace

import pytest
from relaxation_cases import WALLED

from dvr_jax.checker.replay import check_motion
from dvr_jax.dataset.labelling import LabelOptions
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, LogicError, enumerate_sequences
from dvr_jax.operators import ground_scene
from dvr_jax.planning.causes import with_causes
from dvr_jax.planning.feasibility import feasibility
from dvr_jax.planning.label_workers import label_scenes
from dvr_jax.planning.planner import plan
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.search.explanation import Refutation
from dvr_jax.search.reasons import APPROACH

BOX = SceneObject("a", "box", (0.05, 0.15, 0.1), (-0.2, 0.1), 0.3)
SCENE = Scene((BOX,), OnRegion("a", Region((-0.1, -0.2), 0.2, (0.22, 0.22))))


def test_verdicts_are_those_of_a_sweep() -> None:
    grounding = ground_scene(SCENE)
    sequences = [
        [grounding.actions[i] for i in sequence] for sequence in enumerate_sequences(grounding, 2)
    ]
    verdicts = {verdict.actions: verdict for verdict in feasibility(SCENE, sequences)}
    assert len(verdicts) == len(sequences)
    ((_, labels),) = label_scenes([SCENE], 0, LabelOptions(solutions=10**6, k_max=2), width=1)
    labelled = 0
    for label in labels:
        prefix = tuple(map(Action.parse, label.actions))
        for actions, verdict in verdicts.items():
            if actions[: len(prefix)] == prefix:
                assert (verdict.feasible, verdict.bound) == (label.feasible, label.bound)
                labelled += 1
    assert labelled == len(sequences)
    # 15 cm are too wide for the gripper, 5 cm are not.
    assert all(
        verdict.bound == "symbolic"
        for actions, verdict in verdicts.items()
        if "y" in actions[0].arguments[1]
    )
    feasible = [verdict for verdict in verdicts.values() if verdict.feasible]
    assert feasible and all(verdict.violation <= 1 for verdict in feasible)
    for verdict in verdicts.values():
        assert (verdict.motion is not None) == verdict.feasible
        assert verdict.motion is None or check_motion(SCENE, verdict.actions, verdict.motion).passed


def test_a_verdict_does_not_depend_on_what_else_is_asked() -> None:
    arms = SCENE.workcell.arm_names
    names = [
        [f"grasp({arm}, {face}, a)", f"place({arm}, a, goal)"]
        for arm in arms
        for face in ("+x", "-x")
    ]
    together = feasibility(SCENE, [*names, names[0]])
    assert together[0] == together[-1]
    for sequence, verdict in zip(names, together, strict=False):
        (alone,) = feasibility(SCENE, [sequence])
        assert (alone.actions, alone.feasible, alone.bound) == (
            verdict.actions,
            verdict.feasible,
            verdict.bound,
        )
        assert alone.violation == pytest.approx(verdict.violation, nan_ok=True)


def test_nothing_asked_is_nothing_said() -> None:
    assert feasibility(SCENE, []) == []


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(DvrError, match="seed is -1"):
        feasibility(SCENE, [], seed=-1)


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        (["place(left, a, goal)"], "action 1 of 1: place(left, a, goal) is not applicable"),
        (["grasp(left, +z, a)"], "argument 2 is '+z'; valid: +x"),
        (
            ["grasp left"],
            "'grasp left' is no action; valid is for instance 'grasp(left, +x, yellow)'.",
        ),
        ([], "the empty sequence: this sequence of length 0 does not reach the goal"),
    ],
)
def test_what_the_logic_forbids_is_named(sequence: list[str], message: str) -> None:
    with pytest.raises(LogicError) as refused:
        feasibility(SCENE, [sequence])
    assert message in str(refused.value)


def test_actions_are_read_as_they_are_written() -> None:
    action = Action("grasp", ("left", "+x", "a"))
    assert Action.parse(str(action)) == action
    assert math.isnan(
        feasibility(SCENE, [["grasp(left, +y, a)", "place(left, a, goal)"]])[0].violation
    )


def test_a_reason_of_the_optimizer_says_so_until_it_is_confirmed() -> None:
    grasp = ["grasp(left, +y, cube)"]
    (verdict,) = feasibility(WALLED, [grasp])
    assert verdict.reason is not None and not verdict.reason.confirmed
    assert APPROACH in str(verdict.reason)
    (confirmed,) = feasibility(WALLED, [grasp], confirm_reasons=True)
    assert confirmed.reason is not None and confirmed.reason.confirmed
    assert APPROACH not in str(confirmed.reason) and "wall" in confirmed.reason.bodies


def test_reported_sequences_get_confirmed_reasons() -> None:
    """Those of a plan that was not found; the ones that are exact stay as they are."""
    grasp = (Action.parse("grasp(left, +y, cube)"),)
    wide = (Action.parse("grasp(left, +x, wall)"),)
    verdicts = feasibility(WALLED, [grasp, wide])
    refuted = [Refutation(v.actions, v.bound, v.reason) for v in verdicts if v.reason is not None]
    found = plan(WALLED, "mbts", k_max=1)
    result = with_causes(replace(found, refuted=tuple(refuted)))
    assert [item.actions for item in result.refuted] == [grasp, wide]
    assert [item.reason.confirmed for item in refuted] == [False, True]
    assert all(item.reason.confirmed for item in result.refuted)
    assert result.refuted[1] == refuted[1] and "wall" in result.refuted[0].reason.bodies
