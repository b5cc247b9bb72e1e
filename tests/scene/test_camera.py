"""The depth sensor against distances on paper, `mj_ray`, geometry of the masks, and OpenGL where there is one."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dvr_jax.errors import DvrError
from dvr_jax.scene.camera import (
    FARTHEST_DEPTH,
    cast_rays,
    empty_depth,
    render_depth,
    render_depth_of_state,
)
from dvr_jax.scene.files import (
    FixedBody,
    OnRegion,
    Region,
    Scene,
    SceneObject,
    make_scene,
    scene_to_json,
)
from dvr_jax.scene.mjcf import LOOKS_GROUP, SOLID_GROUP, build_home_data, build_model, qpos_layout
from dvr_jax.scene.pinhole import SCENE_CAMERA, Pinhole
from dvr_jax.scene.sampling import SceneDistribution, sample_scenes
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import SINGLE_ARM_WORKCELL, WORKCELLS, Workcell

SCENE = make_scene(
    [
        SceneObject("tall", "box", (0.2, 0.1, 0.2), (0.0, 0.2), 0.0),
        SceneObject("can", "cylinder", (0.08, 0.1), (0.05, -0.3), 0.0),
    ],
    OnRegion("tall", Region((0.0, -0.3), math.pi / 4, (0.3, 0.3))),
)
OBLIQUE = Pinhole(position=(0.3, -1.2, 1.4), target=(0.0, 0.0, 0.1), field_of_view=0.8)

RENDERER = """
import sys, json, numpy as np, mujoco
from dvr_jax.scene.files import scene_from_json
from dvr_jax.scene.mjcf import build_model, build_home_data, GOAL_GROUP
scene = scene_from_json(sys.argv[1])
model = build_model(scene)
model.vis.quality.offsamples = 0  # no antialiasing: one sample in the pixel's centre, as the rays
try:
    renderer = mujoco.Renderer(model, 160, 160)
except Exception as error:
    print("no GL context:", type(error).__name__, error)
    sys.exit(77)
option = mujoco.MjvOption()
option.geomgroup[GOAL_GROUP] = 0
renderer.enable_depth_rendering()
renderer.update_scene(build_home_data(model), camera="scene", scene_option=option)
np.save(sys.argv[2], renderer.render())
"""


def test_depth_on_paper() -> None:
    image = render_depth(SCENE, 201, 201)
    height = SCENE_CAMERA.position[2]
    assert image.depth[100, 100] == pytest.approx(height)  # the table, straight below
    assert image.depth.shape == (201, 201) and image.depth.dtype == np.float32
    for mask, top in zip(image.object_masks, (0.2, 0.1), strict=True):
        # Depth is along the axis, so the whole top face of an object has one depth, however far aside it stands.
        on_top = np.abs(image.depth[mask] - (height - top)) < 1e-5
        assert on_top.mean() > 0.8
    # Top face of the box: 0.2 x 0.1 m, 0.2 m above the table.
    pixel = 2 * (height - 0.2) * math.tan(SCENE_CAMERA.field_of_view / 2) / 201
    count = np.sum(image.object_masks[0] & (np.abs(image.depth - (height - 0.2)) < 1e-5))
    assert count * pixel**2 == pytest.approx(0.02, rel=0.05)
    assert image.depth[0, 100] == FARTHEST_DEPTH  # beyond the table's edge


def test_masks_lie_where_things_stand() -> None:
    size = 201
    image = render_depth(SCENE, size, size)
    half = SCENE_CAMERA.position[2] * math.tan(SCENE_CAMERA.field_of_view / 2)
    x = (np.arange(size) + 0.5) / size * 2 * half - half
    world_x, world_y = np.meshgrid(x, -x)  # of each pixel's ray on the table
    goal = np.abs(world_x) + np.abs(world_y + 0.3) <= 0.15 * math.sqrt(2)
    assert (image.goal_mask == goal).mean() > 0.9999
    assert np.all(
        image.goal_mask & image.object_masks[1] == image.object_masks[1] & goal
    )  # occupied, not cut out
    for mask, item in zip(image.object_masks, SCENE.objects, strict=True):
        assert world_x[mask].mean() == pytest.approx(item.position[0], abs=0.02)
        assert world_y[mask].mean() == pytest.approx(item.position[1], abs=0.04)
    assert not np.any(image.object_masks.sum(axis=0) > 1)


@pytest.mark.parametrize("camera", [SCENE_CAMERA, OBLIQUE])
def test_multi_ray_misses_nothing(camera: Pinhole) -> None:
    """`mj_multiRay` culls by bounding boxes; `mj_ray` looks at every geom: they must agree on every ray."""
    model = build_model(SCENE)
    data, layout, generator = build_home_data(model), qpos_layout(SCENE), np.random.default_rng(0)
    groups, nearest = np.array([0, 1, 1, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    rays = camera.pixel_rays(40, 40)
    for _ in range(6):
        data.qpos[layout.arm_joints] = generator.uniform(
            *PANDA.joint_limits, layout.arm_joints.shape
        )
        mujoco.mj_forward(model, data)
        hits = cast_rays(model, data, camera.position, rays, (SOLID_GROUP, LOOKS_GROUP))
        for ray, distance, geom in zip(
            rays.reshape(-1, 3), hits.distance.ravel(), hits.geom.ravel(), strict=True
        ):
            expected = mujoco.mj_ray(
                model, data, np.array(camera.position), ray, groups, True, -1, nearest, None
            )
            assert (expected < 0) == (geom < 0)
            assert geom < 0 or distance == pytest.approx(expected, abs=1e-9)


def test_hidden_objects_have_empty_masks() -> None:
    objects = (
        SceneObject("front", "box", (0.3, 0.02, 0.4), (0.0, -0.1), 0.0),
        SceneObject("behind", "box", (0.05, 0.05, 0.05), (0.0, 0.0), 0.0),
    )
    scene = Scene(objects, OnRegion("behind", Region((0.0, 0.0), 0.0, (0.1, 0.1))))
    model = build_model(scene)
    level = Pinhole(position=(0.0, -1.5, 0.15), target=(0.0, 0.0, 0.1), field_of_view=0.5)
    image = render_depth_of_state(scene, model, build_home_data(model), 64, 48, level)
    assert image.object_masks[0].any() and not image.object_masks[1].any()
    assert image.goal_mask.any() and image.goal_mask.shape == (48, 64)


def test_the_initial_state_is_seen_as_any_state_is() -> None:
    """Only the rays near objects are cast; all objects, some under the arms, are seen as if all rays were."""
    scenes = [
        *sample_scenes(10, 2, 1),
        *sample_scenes(5, 5, 1),
        *sample_scenes(5, 2, 1, SceneDistribution("cylinder")),
    ]
    crowded = SceneDistribution(fixed_bodies=(1, 4))
    for workcell in WORKCELLS.values():
        scenes += sample_scenes(2, 2, 1, crowded, workcell)
    for scene in scenes:
        model = build_model(scene)
        all_rays = render_depth_of_state(scene, model, build_home_data(model), 120, 90)
        seen = render_depth(scene, 120, 90)
        np.testing.assert_array_equal(seen.depth, all_rays.depth)
        np.testing.assert_array_equal(seen.object_masks, all_rays.object_masks)
        np.testing.assert_array_equal(seen.goal_mask, all_rays.goal_mask)


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_fixed_bodies_are_seen_as_heights(workcell: Workcell) -> None:
    """The empty table has the arms, not the fixed bodies; masks show objects only, and none under a board."""
    objects = (
        SceneObject("seen", "box", (0.1, 0.1, 0.1), (-0.25, 0.3), 0.0),
        SceneObject("hidden", "box", (0.05, 0.05, 0.05), (0.25, 0.5), 0.0),
    )
    board = FixedBody("board", "box", (0.3, 0.3, 0.02), (0.25, 0.5, 0.25), 0.0)
    post = FixedBody("post", "cylinder", (0.05, 0.3), (0.0, 0.7, 0.15), 0.0)
    scene = make_scene(
        objects, OnRegion("seen", Region((0.0, 0.3), 0.0, (0.2, 0.2))), workcell, (board, post)
    )
    size = 200
    image = render_depth(scene, size, size)
    height = empty_depth(workcell, size, size) - image.depth
    half = SCENE_CAMERA.position[2] * math.tan(SCENE_CAMERA.field_of_view / 2)

    def at(x: float, y: float, top: float) -> tuple[int, int]:
        """Pixel that shows the point at a height."""
        scale = SCENE_CAMERA.position[2] / (SCENE_CAMERA.position[2] - top) / (2 * half)
        return int((0.5 - y * scale) * size), int((0.5 + x * scale) * size)

    assert height[at(0.25, 0.5, 0.26)] == pytest.approx(0.26, abs=1e-5)
    assert height[at(0.0, 0.7, 0.3)] == pytest.approx(0.3, abs=1e-5)
    assert height[at(-0.25, 0.3, 0.1)] == pytest.approx(0.1, abs=1e-5)
    assert image.object_masks[0].any() and not image.object_masks[1].any()
    assert not image.object_masks[0][at(0.25, 0.5, 0.26)]
    arms = empty_depth(workcell, size, size) < SCENE_CAMERA.position[2] - 0.3
    columns = np.nonzero(arms)[1]
    expected = 1 if workcell == SINGLE_ARM_WORKCELL else 2
    assert np.sum(np.diff(np.unique(columns)) > 5) + 1 == expected


def test_rays_outside_a_balls_window_miss_it() -> None:
    generator = np.random.default_rng(0)
    smaller = 0
    for _ in range(50):
        camera = Pinhole(
            tuple(generator.normal(size=3).tolist()),
            tuple(generator.normal(size=3).tolist()),
            generator.uniform(0.3, 1.5),
        )
        center = tuple(generator.normal(size=3).tolist())
        radius = generator.uniform(0.05, 0.5)
        rays = camera.pixel_rays(80, 60)
        towards = np.subtract(center, camera.position)
        along = np.maximum((rays @ towards) / (rays**2).sum(-1), 0)
        met = np.linalg.norm(along[..., None] * rays - towards, axis=-1) <= radius
        window = camera.window(center, radius, 80, 60)
        smaller += met[window].size < met.size and met.any()
        met[window] = False
        assert not met.any()
    assert smaller > 5


def test_camera_sees_the_workspace() -> None:
    corners = np.array([[x, y, 0.0] for x in (-0.83, 0.83) for y in (-0.58, 0.58)])
    local = (corners - SCENE_CAMERA.position) @ SCENE_CAMERA.rotation()
    slope = np.abs(local[:, :2] / local[:, 2:])
    assert np.all(slope < math.tan(SCENE_CAMERA.field_of_view / 2))


@pytest.mark.parametrize(("width", "height"), [(0, 64), (64, 7), (5000, 64), (-1, -1)])
def test_refuses_image_sizes(width: int, height: int) -> None:
    with pytest.raises(DvrError, match="valid are 8 to 4096"):
        render_depth(SCENE, width, height)


@pytest.mark.parametrize("library", ["egl", "osmesa"])
def test_agrees_with_the_renderer(library: str, tmp_path: Path) -> None:
    file = tmp_path / "depth.npy"
    ended = subprocess.run(
        [sys.executable, "-c", RENDERER, json.dumps(json.loads(scene_to_json(SCENE))), str(file)],
        env=os.environ | {"MUJOCO_GL": library, "PYTHONPATH": os.getcwd()},
        capture_output=True,
        text=True,
        timeout=120,
    )
    if not file.exists():
        reason = (ended.stdout + ended.stderr).strip().splitlines()[-1:]
        pytest.skip(f"{library} gives no GL context here: {' '.join(reason)}")
    rendered, image = np.load(file), render_depth(SCENE, 160, 160)
    met = image.depth < FARTHEST_DEPTH
    difference = np.abs(rendered - image.depth)[met]
    # Silhouettes may fall a pixel aside; round surfaces are facets in OpenGL.
    assert np.median(difference) < 1e-3
    assert np.mean(difference < 5e-3) > 0.99
