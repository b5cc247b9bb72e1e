"""Scenes with goals of several facts are solved in one call, and the facts hold where MuJoCo has the objects."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import dvr_jax as dvr
from dvr_jax.geometry.footprint import inside, signed_distance
from dvr_jax.scene.mjcf import build_model, object_body_name
from dvr_jax.scene.types import Scene, SceneObject

PLATE = dvr.Region((-0.3, 0.0), 0.1, (0.2, 0.2), "plate")


def box(name: str, x: float, y: float) -> SceneObject:
    return SceneObject(name, "box", (0.05, 0.07, 0.08), (x, y), 0.3)


def end_of(plan: dvr.Plan) -> dict[str, SceneObject]:
    """The objects where MuJoCo's kinematics has them at the end of a motion, seen from above."""
    assert plan.motion is not None
    model = build_model(plan.scene)
    data = mujoco.MjData(model)
    data.qpos[:] = plan.motion.qpos[-1]
    mujoco.mj_kinematics(model, data)
    ends = {}
    for item in plan.scene.objects:
        body = data.body(object_body_name(item.name))
        yaw = float(np.arctan2(body.xmat[3], body.xmat[0]))
        ends[item.name] = replace(item, position=(body.xpos[0], body.xpos[1]), yaw=yaw)
    return ends


def test_two_objects_on_a_plate_with_the_network() -> None:
    scene = Scene(
        (box("a", -0.3, 0.35), box("b", -0.35, -0.3)),
        dvr.Goal((dvr.On("a", "plate"), dvr.On("b", "plate"), dvr.HandsEmpty())),
        regions=(PLATE,),
    )
    plan = dvr.plan(scene, termination="feasible", time_limit=1200)
    assert plan.solved and plan.options["search"] == "dvr"
    assert plan.options["k_max"] == 8
    assert [action.operator for action in plan.actions].count("place") == 2
    for item in end_of(plan).values():
        assert inside(item.footprint, PLATE.footprint, 2e-3)

    # The end is the start of another plan, which keeps what was reached.
    after = plan.scene_after()
    assert after.goal == scene.goal and after.regions == scene.regions
    again = dvr.plan(after)
    assert again.solved and again.actions == ()


@pytest.mark.slow
@pytest.mark.parametrize("search", ["mbts"])
def test_a_region_is_cleared_and_stays_clear(search: str) -> None:
    scene = Scene(
        (box("a", -0.3, 0.02), box("b", -0.35, -0.3)),
        dvr.Goal((dvr.Clear("plate"), dvr.Holding("left", "b"))),
        regions=(PLATE,),
    )
    plan = dvr.plan(scene, search=search, termination="feasible", time_limit=1200)
    assert plan.solved and len(plan.actions) == 3
    assert signed_distance(end_of(plan)["a"].footprint, PLATE.footprint) > -1e-3
    assert plan.actions[-1].arguments[::2] == ("left", "b")
