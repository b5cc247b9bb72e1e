"""A goal that holds from the start needs no action; its plan is saved, read, drawn, executed and exported."""

from pathlib import Path

import dvr_jax as dvr
from dvr_jax.drawing.film import encode_film
from dvr_jax.execution import execute
from dvr_jax.planning.export import export_csv, export_ros
from dvr_jax.scene.files import scene_from_json
from dvr_jax.scene.types import Scene


def scene_with_region_at(x: float) -> Scene:
    return scene_from_json(
        '{"version": 1, "objects": [{"name": "cube", "shape": "box", "size": [0.05, 0.05, 0.05], '
        '"position": [-0.35, 0.0], "yaw": 0.0}], "goal": {"object": "cube", "region": '
        f'{{"position": [{x}, 0], "yaw": 0.0, "size": [0.12, 0.12]}}}}}}'
    )


def test_no_action_is_needed(tmp_path: Path) -> None:
    said: list[str] = []
    scene = scene_with_region_at(-0.35)
    plan = dvr.plan(scene, progress=said.append)
    assert (
        plan.solved
        and plan.actions == ()
        and said == ["the goal holds already: no action is needed"]
    )
    assert plan.motion is not None and plan.report is not None and plan.report.passed

    plan.save(tmp_path)
    assert dvr.Plan.load(tmp_path) == plan
    assert (tmp_path / "film.png").exists() and (tmp_path / "plan.gif").exists()
    assert plan.scene_after() == scene
    assert dvr.check(scene, [], plan.motion, dynamics=True).passed
    assert execute(scene, (), plan.motion).report.succeeded
    export_csv(tmp_path / "a.csv", scene, plan.motion)
    export_ros(tmp_path / "a.json", scene, plan.motion)
    assert encode_film(scene, (), plan.motion).startswith(b"\x89PNG")


def test_an_object_may_reach_over_the_border_as_far_as_after_a_plan() -> None:
    """By 1 mm: the cube ends at -0.325, and the region 1 mm and 1 um before it."""
    from dvr_jax.checker import CHECKS
    from dvr_jax.operators import OPERATORS
    from dvr_jax.planning.goal_met import resting_plan

    too_far = scene_with_region_at(-0.386 - 1e-6)
    assert resting_plan(too_far, OPERATORS, CHECKS, {}) is None
    assert resting_plan(scene_with_region_at(-0.386 + 1e-6), OPERATORS, CHECKS, {}) is not None
