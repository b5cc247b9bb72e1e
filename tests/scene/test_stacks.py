"""Objects that stand on each other at the start: files, refusals, and MuJoCo's poses, contacts and physics."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from stack_cases import APART, PILE, PLATE, cube

from dvr_jax.errors import SceneError
from dvr_jax.goals import Goal, HandsEmpty, Holding, On
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.mjcf import build_home_data, build_model, object_body_name
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.stacks import objects_above
from dvr_jax.scene.start import goal_holds_at_start, objects_as_supports, start_facts
from dvr_jax.scene.types import FixedBody, Scene, SceneObject

BENCH = FixedBody("bench", "box", (0.3, 0.2, 0.12), (-0.3, 0.0, 0.06), 0.0)
CAN = SceneObject("can", "cylinder", (0.03, 0.08), (0.2, 0.3), 0.0)
PLATFORM = SceneObject("d", "box", (0.1, 0.1, 0.03), (0.2, 0.3), 0.5, support="can")
SCENE = Scene(
    (replace(PILE[0], support="bench"), *PILE[1:], CAN, PLATFORM),
    Goal((On("c", "plate"),)),
    fixed=(BENCH,),
    regions=(PLATE,),
)
"""A pile of three cubes on a bench, and a board that reaches over a can on all sides."""


def test_a_file_gives_the_scene_back() -> None:
    record = json.loads(scene_to_json(SCENE))
    supports = [item.get("support") for item in record["objects"]]
    assert supports == ["bench", "a", "b", None, "can"]
    assert scene_from_json(json.dumps(record)) == SCENE


def test_the_bodies_of_mujoco_stand_on_each_other() -> None:
    data = build_home_data(build_model(SCENE))
    bottoms = (0.12, 0.17, 0.22, 0.0, 0.08)
    for item, bottom in zip(SCENE.objects, bottoms, strict=True):
        center = data.body(object_body_name(item.name)).xpos
        np.testing.assert_allclose(center, [*item.position, bottom + item.height / 2], atol=1e-12)
    assert np.abs(np.asarray(data.contact.dist)).max(initial=0) < 1e-6


def test_the_camera_sees_the_tops_of_stacks() -> None:
    """The ray to the top of the pile ends there, and hits none of the lower cubes."""
    image = render_depth(SCENE, 256, 256)
    top = np.array([*PILE[2].position, 0.27])
    rays = SCENE_CAMERA.pixel_rays(256, 256)
    way = top - np.asarray(SCENE_CAMERA.position)
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    pixel = np.unravel_index(np.argmax(unit @ (way / np.linalg.norm(way))), (256, 256))
    assert image.depth[pixel] == pytest.approx(SCENE_CAMERA.position[2] - 0.27, abs=1e-4)
    np.testing.assert_array_equal(image.object_masks[:, *pixel], [False, False, True, False, False])


def test_a_pile_of_three_stands_in_physics() -> None:
    """Each cube is shifted by as much as the planner allows: a quarter of half its width."""
    shifted = [
        replace(item, position=(-0.3 + 0.00625 * n, 0.00625 * n)) for n, item in enumerate(PILE)
    ]
    scene = Scene(tuple(shifted), SCENE.goal, regions=(PLATE,))
    assert scene_from_json(scene_to_json(scene)) == scene
    model = build_model(scene)
    data = build_home_data(model)
    model.opt.timestep = 1e-3
    bodies = [model.body(object_body_name(item.name)).id for item in shifted]
    before = data.xpos[bodies].copy()
    # The arms hang in the air: gravity would pull them down onto the table.
    model.body_gravcomp[:] = [0.0 if body in bodies else 1.0 for body in range(model.nbody)]
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert np.abs(data.xpos[bodies] - before).max() < 2e-3


def test_what_holds_at_the_start() -> None:
    assert {("on", "b", "a"), ("on", "c", "b"), ("on", "d", "can")} == set(start_facts(SCENE))
    assert objects_as_supports(SCENE) == ("a", "b", "can")
    assert objects_above(SCENE, "a") == ("b", "c") and objects_above(SCENE, "c") == ()
    assert goal_holds_at_start(replace(SCENE, goal=Goal((On("b", "a"), HandsEmpty()))))
    assert not goal_holds_at_start(replace(SCENE, goal=Goal((On("a", "b"),))))


def test_the_table_stays_the_table_if_an_object_has_its_name() -> None:
    scene = Scene((cube("table", 0.0, 0.0), cube("a", 0.2, 0.3)), Goal((Holding("left", "a"),)))
    assert scene_from_json(scene_to_json(scene)) == scene
    assert objects_as_supports(scene) == () and scene.bottom_of(scene.objects[1]) == 0


def changed(index: int, **values: Any) -> Callable[[], Scene]:
    record = json.loads(scene_to_json(SCENE))
    record["objects"][index].update(values)
    return lambda: scene_from_json(json.dumps(record))


def with_goal(*facts: list[str]) -> Callable[[], Scene]:
    pin = SceneObject("pin", "cylinder", (0.006, 0.08), (0.4, -0.3), 0.0)
    scene = Scene((*APART, pin), Goal((On("c", "plate"),)), regions=(PLATE,))
    record = json.loads(scene_to_json(scene))
    record["goal"] = facts
    return lambda: scene_from_json(json.dumps(record))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (changed(2, support="e"), "'c' stands on 'e'; valid are 'table' .* and the other objects"),
        (changed(2, support="a"), "'b' and 'c' both stand on 'a'; valid is one"),
        (changed(2, support="c"), "in a circle: 'c' on 'c'"),
        (changed(0, support="c"), "in a circle: 'a' on 'c' on 'b' on 'a'"),
        (changed(2, position=[-0.278, 0.0]), "center of 'c' is not over the top of 'b'"),
        (changed(4, position=[0.2, 0.32]), "center of 'd' is not over the top of 'can'"),
        (changed(2, support="table"), "'b' and 'c' overlap|'a' and 'c' overlap|bench"),
        (changed(1, size=[0.05, 0.05, 1.9]), "'c' reaches 2.* m above the table|'b' reaches"),
        (with_goal(["on", "a", "e"]), "names the support 'e'; the scene has 'plate', 'a', 'b'"),
        (with_goal(["on", "a", "a"]), "'a' on 'a', which is a circle"),
        (
            with_goal(["on", "a", "b"], ["on", "b", "c"], ["on", "c", "a"]),
            "'a' on 'b' on 'c' on 'a', which is a circle",
        ),
        (with_goal(["on", "a", "b"], ["on", "c", "b"]), "one object at most stands on 'b'"),
        (with_goal(["on", "a", "b"], ["on", "a", "c"]), "'a' is in one place"),
        (with_goal(["on", "a", "b"], ["holding", "left", "b"]), "nothing stands on 'b' while"),
        (with_goal(["on", "a", "pin"]), "'a' on 'pin', whose top is too small"),
    ],
)
def test_a_refusal_names_the_culprit(make: Callable[[], Scene], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()


def test_a_lower_object_may_be_held_while_nothing_stands_on_it() -> None:
    assert with_goal(["on", "a", "b"], ["holding", "left", "c"])().goal.facts[0] == On("a", "b")
