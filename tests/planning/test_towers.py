"""Towers are built and taken down: plans pass the check and physics, and their ends are starts of further plans."""

from dataclasses import replace
from pathlib import Path

import pytest

import dvr_jax as dvr
from dvr_jax.execution import execute
from dvr_jax.scene.validation import validate_scene

SCENES = Path(__file__).parents[2] / "data" / "scenes"


@pytest.mark.slow
@pytest.mark.parametrize("search", ["dvr", "mbts"])
def test_a_tower_of_three_is_built_and_taken_down(search: str) -> None:
    scene = dvr.load_scene(SCENES / "tower.json")
    said: list[str] = []
    plan = dvr.plan(
        scene, search=search, termination="feasible", time_limit=1200, progress=said.append
    )
    assert plan.solved and len(plan.actions) == 4
    assert execute(plan.scene, plan.actions, plan.motion).report.succeeded
    assert any("does not know objects that stand on each other" in line for line in said) == (
        search == "dvr"
    )

    tower = plan.scene_after()
    validate_scene(tower)
    assert [item.support for item in tower.objects] == ["green", "blue", "table"]
    assert tower.bottom_of(tower.objects[0]) == pytest.approx(0.1)
    assert dvr.plan(tower).actions == ()

    # The middle cube is moved after the one that stands on it.
    region = dvr.Region((-0.3, -0.3), 0.0, (0.12, 0.12), "spot")
    goal = dvr.Goal((dvr.On("green", "spot"), dvr.HandsEmpty()))
    down = dvr.plan(replace(tower, goal=goal, regions=(region,)), search="mbts", time_limit=1200)
    assert down.solved and len(down.actions) == 4
    assert "red" in down.actions[0].arguments
    assert execute(down.scene, down.actions, down.motion).report.succeeded
