"""Objects and regions on the tops of fixed bodies: their files, their refusals, and where MuJoCo has them."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dvr_jax.errors import SceneError
from dvr_jax.goals import Clear, Goal, Inside, On, Region
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.mjcf import build_home_data, build_model, object_body_name
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.start import goal_holds_at_start, start_facts
from dvr_jax.scene.types import FixedBody, Scene, SceneObject

BENCH = FixedBody("bench", "box", (0.3, 0.2, 0.12), (-0.2, 0.3, 0.06), 0.0)
COLUMN = FixedBody("column", "cylinder", (0.1, 0.3), (0.2, -0.3, 0.15), 0.0)
UPPER = Region((-0.2, 0.3), 0.0, (0.2, 0.15), "upper", support="bench")
BELOW = Region((0.2, 0.3), 0.0, (0.2, 0.2), "below")
RAISED = SceneObject("raised", "box", (0.05, 0.07, 0.08), (-0.2, 0.3), 0.2, support="bench")
CAN = SceneObject("can", "cylinder", (0.03, 0.1), (0.2, -0.3), 0.0, support="column")
LOW = SceneObject("low", "box", (0.05, 0.07, 0.08), (-0.2, -0.2), 0.2)
SCENE = Scene(
    (RAISED, CAN, LOW), Goal((On("low", "upper"),)), fixed=(BENCH, COLUMN), regions=(UPPER, BELOW)
)


def test_a_file_gives_the_scene_back() -> None:
    record = json.loads(scene_to_json(SCENE))
    assert [item.get("support") for item in record["objects"]] == ["bench", "column", None]
    assert scene_from_json(json.dumps(record)) == SCENE


def test_the_bodies_of_mujoco_stand_on_their_supports() -> None:
    data = build_home_data(build_model(SCENE))
    for item, bottom in zip(SCENE.objects, (0.12, 0.30, 0.0), strict=True):
        center = data.body(object_body_name(item.name)).xpos
        np.testing.assert_allclose(center, [*item.position, bottom + item.height / 2], atol=1e-12)
        np.testing.assert_allclose(SCENE.center_of(item), center, atol=1e-12)
    # The tops touch the bottoms: nothing penetrates, and nothing hangs in the air.
    assert np.abs(np.asarray(data.contact.dist)).max(initial=0) < 1e-6
    region = data.geom("region upper").xpos
    np.testing.assert_allclose(region, [-0.2, 0.3, 0.12], atol=1e-12)


def test_the_mask_of_a_raised_region_is_where_the_camera_sees_its_height() -> None:
    """A ray through the mask's middle meets the region's middle at its height."""
    scene = replace(SCENE, objects=(LOW,), regions=(UPPER,))
    image = render_depth(scene, 256, 256)
    rows, columns = np.nonzero(image.goal_mask)
    ray = SCENE_CAMERA.pixel_rays(256, 256)[round(rows.mean()), round(columns.mean())]
    point = np.asarray(SCENE_CAMERA.position) + ray * (0.12 - SCENE_CAMERA.position[2]) / ray[2]
    np.testing.assert_allclose(point, [-0.2, 0.3, 0.12], atol=0.012)


def test_an_object_is_on_the_regions_of_its_support_alone() -> None:
    above = replace(BELOW, name="above", support="bench", position=(-0.2, 0.3), size=(0.2, 0.15))
    beneath = replace(above, name="beneath", support="table")
    scene = replace(SCENE, regions=(UPPER, BELOW, above, beneath))
    assert {("on", "raised", "upper"), ("on", "raised", "above")} == set(start_facts(scene))
    assert goal_holds_at_start(replace(scene, goal=Goal((Clear("beneath"),))))
    assert not goal_holds_at_start(replace(scene, goal=Goal((Clear("above"),))))


def changed(part: str, index: int, **values: Any) -> Callable[[], Scene]:
    record = json.loads(scene_to_json(SCENE))
    record[part][index].update(values)
    return lambda: scene_from_json(json.dumps(record))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            changed("objects", 0, support="shelf"),
            "'raised' stands on 'shelf'; valid are 'table' and the fixed bodies .'bench', 'column'",
        ),
        (
            changed("objects", 0, position=[-0.06, 0.3]),
            "'raised' at .* reaches off the top of the fixed body 'bench'",
        ),
        (
            changed("objects", 1, position=[0.28, -0.3]),
            "'can' at .* reaches off the top of the fixed body 'column'",
        ),
        (changed("objects", 0, support="table"), "'raised' and the fixed body 'bench' overlap"),
        (changed("objects", 1, size=[0.03, 1.8]), "'can' reaches 2.1 m above the table"),
        (
            changed("regions", 0, size=[0.2, 0.25]),
            "the region 'upper' at .* reaches off the top of the fixed body 'bench'",
        ),
        (changed("regions", 0, support="low"), "the region 'upper' lies on 'low'; valid are"),
    ],
)
def test_a_refusal_names_the_culprit(make: Callable[[], Scene], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()


def test_a_body_that_hangs_low_over_a_raised_region_is_named() -> None:
    """The board hangs 7 cm over the bench, and the object is 8 cm high; another one of 6 cm fits."""
    board = FixedBody("board", "box", (0.3, 0.2, 0.02), (-0.2, 0.3, 0.2), 0.0)
    scene = replace(SCENE, objects=(LOW,), fixed=(BENCH, COLUMN, board))
    with pytest.raises(SceneError, match="'board' stands on the whole region 'upper'"):
        scene_from_json(scene_to_json(scene))
    flat = replace(scene, objects=(replace(LOW, size=(0.05, 0.07, 0.06)),))
    assert scene_from_json(scene_to_json(flat)) == flat


def test_what_stands_below_does_not_overlap() -> None:
    """An object under a table of legs, and one on its top right above the other."""
    top = FixedBody("top", "box", (0.3, 0.2, 0.02), (-0.2, 0.3, 0.2), 0.0)
    upper = replace(RAISED, support="top")
    lower = replace(LOW, position=RAISED.position)
    region = replace(UPPER, support="top", inside=Inside.CENTER)
    scene = replace(SCENE, objects=(upper, lower), fixed=(top,), regions=(region,))
    assert scene_from_json(scene_to_json(scene)) == scene
