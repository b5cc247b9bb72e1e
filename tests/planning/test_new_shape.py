"""A shape that only these tests define is read from a scene file, planned with, checked and drawn."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tile import TILE, TILE_CHECK

from dvr_jax.checker.replay import check_motion
from dvr_jax.checker.shapes import register_shape_check
from dvr_jax.checker.shapes import shape as check_registry
from dvr_jax.errors import SceneError
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.files import load_scene, scene_from_json
from dvr_jax.scene.types import FixedBody
from dvr_jax.shapes import register_shape
from dvr_jax.shapes import shape as registry

SCENE_FILE = {
    "version": 1,
    "objects": [
        {
            "name": "slab",
            "shape": "tile",
            "size": [0.07, 0.06],
            "position": [-0.35, 0.25],
            "yaw": 0.4,
        },
        {
            "name": "can",
            "shape": "cylinder",
            "size": [0.03, 0.12],
            "position": [0.4, 0.3],
            "yaw": 0.0,
        },
    ],
    "goal": {
        "object": "slab",
        "region": {"position": [-0.35, -0.25], "yaw": 0.2, "size": [0.12, 0.12]},
    },
}


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """The tile is known to the package and to its check; afterwards both registries forget it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry._SHAPES, "tile", TILE)
        patch.setitem(check_registry._SHAPE_CHECKS, "tile", TILE_CHECK)
        register_shape(TILE)
        register_shape_check(TILE_CHECK)
        yield


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    path = tmp_path_factory.mktemp("scenes") / "scene.json"
    path.write_text(json.dumps(SCENE_FILE))
    return plan(load_scene(path), "mbts", k_max=2)


def test_a_scene_with_it_is_planned_and_checked(solved: Plan) -> None:
    assert solved.solved and solved.motion is not None
    assert solved.scene.objects[0].kind is TILE
    assert [action.arguments[-2:] for action in solved.actions][1] == ("slab", "goal")
    assert check_motion(solved.scene, solved.actions, solved.motion).passed


def test_the_check_measures_it_by_its_own_formulas(
    solved: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert solved.motion is not None
    thinner = replace(TILE_CHECK, half_width=lambda size, face: 0.025)
    monkeypatch.setitem(check_registry._SHAPE_CHECKS, "tile", thinner)
    report = check_motion(solved.scene, solved.actions, solved.motion)
    assert "grip" in {finding.kind for finding in report.findings}


def test_it_is_seen_by_the_camera_as_a_box_of_the_same_size(solved: Plan) -> None:
    slab = solved.scene.objects[0]
    box = replace(slab, shape="box", size=(0.07, 0.07, 0.06))
    as_box = replace(solved.scene, objects=(box, *solved.scene.objects[1:]))
    ours = render_depth(solved.scene)
    theirs = render_depth(as_box)
    np.testing.assert_array_equal(ours.depth, theirs.depth)
    np.testing.assert_array_equal(ours.object_masks, theirs.object_masks)
    assert ours.object_masks[0].any()


def test_a_fixed_body_may_be_one(solved: Plan) -> None:
    post = FixedBody("post", "tile", (0.05, 0.3), (0.0, 0.5, 0.15), 0.2)
    found = plan(replace(solved.scene, fixed=(post,)), "mbts", k_max=2)
    assert found.solved and found.motion is not None
    assert check_motion(found.scene, found.actions, found.motion).passed


def test_a_size_of_other_numbers_is_refused() -> None:
    broken = json.loads(json.dumps(SCENE_FILE))
    broken["objects"][0]["size"] = [0.07, 0.07, 0.06]
    with pytest.raises(SceneError, match="3 numbers; valid are 2"):
        scene_from_json(json.dumps(broken))
