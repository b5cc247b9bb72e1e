"""Pictures: their form, and that what must be seen is seen, in its color."""

import numpy as np

from dvr_jax.drawing.picture import PICTURE_CAMERA, render_picture
from dvr_jax.scene.colors import FIXED_COLOR, PALETTE, object_colors
from dvr_jax.scene.files import (
    FixedBody,
    OnRegion,
    Region,
    SceneObject,
    load_scene,
    make_scene,
)
from dvr_jax.scene.mjcf import build_home_data, build_model
from dvr_jax.scene.pinhole import Pinhole
from dvr_jax.workcell.workcell import WORKCELLS, Table

ABOVE = Pinhole(position=(0.0, 0.0, 2.0), target=(0.0, 0.0, 0.0), field_of_view=0.7)


def test_shows_the_goal_the_objects_and_both_arms() -> None:
    scene = load_scene("data/scenes/figure1.json")
    model = build_model(scene)
    image = render_picture(model, build_home_data(model), 320, 200).astype(float)
    assert image.shape == (200, 320, 3)
    red = (image[..., 0] > 120) & (image[..., 1] < 60) & (image[..., 2] < 60)
    yellow = (image[..., 0] > 100) & (image[..., 1] > 70) & (image[..., 2] < 60)
    blue = (image[..., 2] > 90) & (image[..., 0] < 60)
    white = image.min(axis=2) > 225
    assert red.sum() > 100 and yellow.sum() > 100 and blue.sum() > 100
    assert (
        np.nonzero(red)[1].min() > 160 > np.nonzero(yellow)[1].max()
    )  # the goal on the right, yellow on the left
    assert white[:, :160].sum() > 50 and white[:, 160:].sum() > 50


def test_the_whole_table_is_in_the_picture() -> None:
    """Of all directions to the table's corners, and up to an outstretched arm above each base, each is a pixel's."""
    x, y = Table().half_extents
    bases = [arm.position for workcell in WORKCELLS.values() for arm in workcell.arms]
    points = np.array([[sx * x, sy * y, 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    points = (
        np.vstack([points, [[base[0], base[1], 0.9] for base in bases]]) - PICTURE_CAMERA.position
    )
    rays = PICTURE_CAMERA.pixel_rays(320, 200)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    spacing = np.arccos(np.einsum("hwi,hwi->hw", rays[:, 1:], rays[:, :-1])).max()
    nearest = np.arccos(np.clip(np.einsum("hwi,pi->phw", rays, points), -1, 1)).min((1, 2))
    assert nearest.max() < spacing


def test_color_of_a_lit_face_keeps_its_hue() -> None:
    scene = make_scene(
        [SceneObject("blue", "box", (0.1, 0.1, 0.1), (0.0, 0.0), 0.0)], _goal("blue")
    )
    model = build_model(scene)
    image = render_picture(model, build_home_data(model), 65, 65, ABOVE)
    shade = image[32, 32] / np.array(object_colors(scene)[0]) / 255
    assert shade.min() > 0.6 and shade.max() < 1.5


def test_a_tall_object_throws_a_shadow() -> None:
    scene = make_scene(
        [SceneObject("green", "box", (0.1, 0.1, 0.2), (0.0, 0.0), 0.0)], _goal("green")
    )
    model = build_model(scene)
    image = (
        render_picture(model, build_home_data(model), 129, 129, ABOVE).astype(float).mean(axis=2)
    )
    towards_lamp, away = image[78:84, 60:66].mean(), image[45:51, 66:70].mean()
    assert away < 0.75 * towards_lamp


def test_fixed_bodies_are_seen_in_their_color() -> None:
    blue = SceneObject("blue", "box", (0.1, 0.1, 0.1), (0.0, -0.4), 0.0)
    board = FixedBody("board", "box", (0.3, 0.3, 0.02), (0.0, 0.0, 0.3), 0.4)
    model = build_model(make_scene([blue], _goal("blue"), fixed=[board]))
    image = render_picture(model, build_home_data(model), 65, 65, ABOVE)
    shade = image[32, 32] / np.array(FIXED_COLOR) / 255
    assert shade.min() > 0.6 and shade.max() < 1.5


def test_both_spellings_of_gray_are_one_color() -> None:
    for name in ("gray", "grey"):
        item = SceneObject(name, "box", (0.1, 0.1, 0.1), (0.0, 0.0), 0.0)
        assert object_colors(make_scene([item], _goal(name))) == (PALETTE["gray"],)


def test_colors_are_distinct() -> None:
    names = ["grey", "red", "x", "y", "z", "blue", "u", "v"]
    objects = [
        SceneObject(name, "box", (0.05, 0.05, 0.05), (0.0, -0.4 + 0.1 * i), 0.0)
        for i, name in enumerate(names)
    ]
    assert len(set(object_colors(make_scene(objects, _goal("x"))))) == 8


def _goal(name: str) -> OnRegion:
    return OnRegion(name, Region((0.3, 0.3), 0.0, (0.1, 0.1)))
