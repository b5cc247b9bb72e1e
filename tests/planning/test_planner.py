"""Small scenes by both searches without a network: they agree, are repeatable, and end when the tree is exhausted."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dvr_jax.errors import DvrError
from dvr_jax.planning.planner import Plan, plan
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.search.status import PlanStatus
from dvr_jax.solver.continuous_collision import BETWEEN_TOLERANCE
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL

REGION = Region((-0.35, -0.25), 0.2, (0.2, 0.2))


def one_box(x: float, y: float) -> Scene:
    return Scene((SceneObject("a", "box", (0.06, 0.12, 0.1), (x, y), 0.4),), OnRegion("a", REGION))


@pytest.fixture(scope="module")
def plans() -> dict[str, Plan]:
    """A box that the left arm can bring to its region, by both searches."""
    return {
        search: plan(one_box(-0.4, 0.3), search, k_max=3, time_limit=300)
        for search in ("mbts", "bfs")
    }


def test_both_find_the_shortest_sequence(plans: dict[str, Plan]) -> None:
    for result in plans.values():
        assert result.solved
        assert len(result.actions) == 2
        assert result.report is not None and result.report.passed
        assert all(value <= 0.01 for value in result.violations.values())


def test_the_same_seed_gives_the_same_plan(plans: dict[str, Plan]) -> None:
    again = plan(one_box(-0.4, 0.3), "mbts", k_max=3, time_limit=300)
    first = plans["mbts"]
    assert again.actions == first.actions
    assert again.nlps == first.nlps
    assert again.motion is not None and first.motion is not None
    assert (again.motion.qpos == first.motion.qpos).all()


@pytest.mark.parametrize("search", ["mbts", "bfs"])
def test_what_no_arm_reaches_exhausts_the_tree(search: str) -> None:
    result = plan(one_box(0.0, 0.9), search, k_max=2, time_limit=300)
    assert result.status == "tree exhausted"
    assert not result.actions and result.motion is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"search": "dfs"}, "no search 'dfs'; valid: dvr, classifier, mbts, bfs"),
        (
            {"search": "mbts", "network": "any"},
            "'mbts' takes no network; valid with one: dvr, classifier",
        ),
        ({"time_limit": 0.0}, "the time limit is 0.0 s"),
        ({"clearance": 3.5}, "the clearance is 3.5; valid is 0 to 3"),
        ({"clearance": math.nan}, "the clearance is nan; valid is 0 to 3"),
        ({"clearance": "wide"}, "the clearance is the text 'wide'; valid is a number"),
    ],
)
def test_requests_that_make_no_sense_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        plan(one_box(-0.4, 0.3), **options)


def test_an_arm_in_collision_at_home_is_refused_before_anything_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left, right = DEFAULT_WORKCELL.arms
    bent = replace(left, home=(0.0, 1.7, 0.0, -0.3, 0.0, 1.6, 0.8))
    workcell = replace(DEFAULT_WORKCELL, arms=(bent, right))
    monkeypatch.setattr(
        "dvr_jax.planning.planner.compiling_ahead",
        lambda *arguments: pytest.fail("began to compile"),
    )
    with pytest.raises(DvrError, match="with the arms at home"):
        plan(replace(one_box(-0.4, 0.3), workcell=workcell), "mbts")


def test_a_plan_takes_the_place_of_another_that_was_found(
    plans: dict[str, Plan], tmp_path: Path
) -> None:
    result = plans["mbts"]
    result.save(tmp_path, animation=False)
    assert {"trajectory.npz", "film.png"} < {path.name for path in tmp_path.iterdir()}
    none_found = replace(result, status=PlanStatus.EXHAUSTED, actions=(), motion=None, report=None)
    none_found.save(tmp_path, animation=False)
    assert {path.name for path in tmp_path.iterdir()} == {"plan.json", "scene.xml", "depth.png"}


def test_the_deadline_is_kept() -> None:
    result = plan(one_box(-0.4, 0.3), "mbts", k_max=3, time_limit=1e-6)
    assert result.status == "time limit"
    assert math.isclose(sum(result.nlps.values()), 0)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_held_objects_are_carried_as_high_as_the_clearance_says(factor: float) -> None:
    """The clearance of 1 cm is kept up to its tolerance, but for the first and the last intervals of the phase."""
    scene = one_box(-0.4, 0.3)
    found = plan(scene, "mbts", k_max=2, clearance=factor)
    assert found.motion is not None and found.scene == scene
    assert found.options["clearance"] == factor
    grasped, placed = found.motion.switch.tolist()
    margin = (placed - grasped) // 5
    height = found.motion.qpos[:, qpos_layout(scene).objects[0, 2]] - scene.objects[0].height / 2
    carried = height[grasped + margin : placed - 2 * margin]
    assert len(carried) > 10 and carried.min() > 0.01 * factor - BETWEEN_TOLERANCE
