"""Scenes with raised supports are solved, checked and executed, and their ends are starts of further plans."""

from pathlib import Path

import pytest

import dvr_jax as dvr
from dvr_jax.execution import execute
from dvr_jax.scene.validation import validate_scene

SCENES = Path(__file__).parents[2] / "data" / "scenes"


@pytest.mark.slow
@pytest.mark.parametrize("search", ["dvr", "mbts"])
def test_objects_go_onto_a_shelf_and_off_it(search: str) -> None:
    scene = dvr.load_scene(SCENES / "shelf.json")
    plan = dvr.plan(scene, search=search, termination="feasible", time_limit=1200)
    assert plan.solved and len(plan.actions) == 4
    assert execute(plan.scene, plan.actions, plan.motion).report.succeeded

    after = plan.scene_after()
    validate_scene(after)
    assert [item.support for item in after.objects] == ["lower", "table"]
    assert after.bottom_of(after.objects[0]) == pytest.approx(0.26)
    again = dvr.plan(after)
    assert again.solved and again.actions == ()
