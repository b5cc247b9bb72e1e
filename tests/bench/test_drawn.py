"""Drawn links that meet something, against `mj_geomDistance`: a post stands in the housing of joint 6."""

import mujoco
import numpy as np
import pytest

from dvr_jax.bench.drawn import drawn_penetrations
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.scene.mjcf import COLLISION_GROUP, LOOKS_GROUP, build_model, home_qpos
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import make_scene

STEP = 0.02


def scene_with_post(y: float) -> Scene:
    post = SceneObject("post", "cylinder", (0.02, 0.8), (-0.53, y), 0.0)
    return make_scene([post], OnRegion("post", Region((0.0, 0.5), 0.0, (0.2, 0.2))))


def at_home(scene: Scene) -> Motion:
    return make_motion(STEP * np.arange(3), np.tile(home_qpos(scene), (3, 1)), [])


def nearest(scene: Scene, group: int) -> float:
    """Distance of the post to the nearest geom of a group of the left arm's fifth link, at home [m]."""
    model = build_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = home_qpos(scene)
    mujoco.mj_kinematics(model, data)
    link, post = model.body("left/link5").id, model.body("object/post").geomadr[0]
    geoms = np.flatnonzero((model.geom_group == group) & (model.geom_bodyid == link))
    return min(
        mujoco.mj_geomDistance(model, data, int(geom), int(post), 1.0, np.zeros(6))
        for geom in geoms
    )


def test_a_post_in_a_drawn_housing_is_found() -> None:
    scene = scene_with_post(0.098)
    depths = drawn_penetrations(scene, at_home(scene))
    assert depths == {
        ("left/link5", "object/post"): pytest.approx(-nearest(scene, LOOKS_GROUP), abs=1e-6)
    }
    assert depths["left/link5", "object/post"] > 0.01


def test_collision_capsules_cover_the_drawn_housing() -> None:
    scene = scene_with_post(0.125)
    assert nearest(scene, COLLISION_GROUP) < nearest(scene, LOOKS_GROUP) + 0.003


def test_nothing_is_found_where_nothing_touches() -> None:
    scene = scene_with_post(0.148)
    assert nearest(scene, LOOKS_GROUP) > 0
    assert drawn_penetrations(scene, at_home(scene)) == {}
