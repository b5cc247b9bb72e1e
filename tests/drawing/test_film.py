"""Pictures of a plan: their form, that they show what they must, and that odd names and lengths do no harm."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dvr_jax.drawing.animation import MOST_FRAMES, save_animation
from dvr_jax.drawing.depth_picture import save_depth_picture
from dvr_jax.drawing.film import save_film
from dvr_jax.errors import DvrError
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.scene.files import (
    FixedBody,
    OnRegion,
    Region,
    Scene,
    SceneObject,
    load_scene,
    make_scene,
)
from dvr_jax.scene.mjcf import home_qpos, qpos_layout
from dvr_jax.workcell.workcell import WORKCELLS, Workcell

SCENE = load_scene("data/scenes/figure1.json")
ACTIONS = ("left grasps yellow at its +x face", "left places yellow on table")


def swing(scene: Scene, samples: int, switch: tuple[int, ...], step: float = 0.02) -> Motion:
    """The first arm turns at its base; nothing is touched."""
    qpos = np.tile(home_qpos(scene), (samples, 1))
    qpos[:, qpos_layout(scene).arm_joints[0, 0]] = np.linspace(0.0, 0.8, samples)
    return make_motion(step * np.arange(samples), qpos, switch)


def test_film_has_a_panel_for_the_start_and_for_each_switch(tmp_path: Path) -> None:
    save_film(tmp_path / "film.png", SCENE, ACTIONS, swing(SCENE, 40, (20, 39)))
    film = np.asarray(Image.open(tmp_path / "film.png").convert("RGB")).astype(float)
    width = (film.shape[1] - 12) // 3
    panels = [film[60:320, 12 + i * width : i * width + width] for i in range(3)]
    for panel in panels:
        red = (panel[..., 0] > 150) & (panel[..., 1] < 60) & (panel[..., 2] < 60)
        assert red.sum() > 100
    assert np.abs(panels[0] - panels[1]).max() > 100 and np.abs(panels[1] - panels[2]).max() > 100
    caption = film[335:360, 12:400]
    assert (caption.min(axis=2) < 60).sum() > 20  # there is text


def test_film_of_six_actions_takes_two_rows(tmp_path: Path) -> None:
    save_film(tmp_path / "film.png", SCENE, ACTIONS * 3, swing(SCENE, 40, (5, 10, 15, 20, 25, 39)))
    size = Image.open(tmp_path / "film.png").size
    assert size == (12 + 4 * 452, 56 + 2 * (275 + 34 + 12))


def test_film_refuses_actions_that_do_not_fit_the_motion(tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="2 switches; valid are 1"):
        save_film(tmp_path / "film.png", SCENE, ACTIONS[:1], swing(SCENE, 40, (20, 39)))


def test_animation_is_small_and_keeps_the_time(tmp_path: Path) -> None:
    save_animation(tmp_path / "plan.gif", SCENE, swing(SCENE, 101, ()), frames_per_second=4.0)
    with Image.open(tmp_path / "plan.gif") as animation:
        assert (
            animation.format == "GIF" and animation.size == (320, 200) and animation.n_frames == 9
        )
        milliseconds = []
        for frame in range(animation.n_frames):
            animation.seek(frame)
            milliseconds.append(animation.info["duration"])
        picture = np.asarray(animation.convert("RGB")).astype(float)
    assert sum(milliseconds[:-1]) == pytest.approx(2000, abs=8 * 10) and milliseconds[-1] == 1500
    assert (
        (picture[..., 0] > 170) & (picture[..., 1] < 60)
    ).sum() > 100  # the goal stays red in the palette
    assert (tmp_path / "plan.gif").stat().st_size < 300_000


def test_animation_of_a_long_motion_is_bounded(tmp_path: Path) -> None:
    motion = swing(SCENE, 200, (), step=0.5)
    save_animation(tmp_path / "plan.gif", SCENE, motion, width=32, height=20)
    with Image.open(tmp_path / "plan.gif") as animation:
        assert animation.n_frames <= MOST_FRAMES
    save_animation(tmp_path / "fast.gif", SCENE, motion, speed=1e6, width=32, height=20)
    with Image.open(tmp_path / "fast.gif") as animation:
        assert animation.n_frames == 2


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_animation_refuses_a_speed_that_is_none(tmp_path: Path, speed: float) -> None:
    with pytest.raises(DvrError, match="speed"):
        save_animation(tmp_path / "plan.gif", SCENE, swing(SCENE, 10, ()), speed=speed)


def test_depth_picture_shows_every_mask_in_its_colour(tmp_path: Path) -> None:
    save_depth_picture(tmp_path / "depth.png", SCENE)
    picture = np.asarray(Image.open(tmp_path / "depth.png").convert("RGB")).astype(int)
    right = picture[:, 480:]
    red = (right[..., 0] > 200) & (right[..., 1] < 60)
    blue = (right[..., 2] > 200) & (right[..., 0] < 120)
    assert red.sum() > 200 and blue.sum() > 50
    assert len(np.unique(picture[40:420, 12:396].reshape(-1, 3), axis=0)) > 5


@pytest.mark.parametrize("count", [1, 8])
def test_odd_names_and_many_objects(tmp_path: Path, count: int) -> None:
    names = ["日本 ü" + " long" * 19, *"abcdefg"][:count]
    objects = [
        SceneObject(name, "cylinder", (0.03, 0.3), (0.1 * i - 0.4, 0.3), 0.0)
        for i, name in enumerate(names)
    ]
    scene = make_scene(objects, OnRegion(names[0], Region((0.0, -0.3), 0.3, (0.1, 0.1))))
    save_film(
        tmp_path / "film.png",
        scene,
        [f"left grasps {names[0]} at its +x face\n \x01 \ud800" + " long" * 60],
        swing(scene, 10, (5,)),
    )
    save_depth_picture(tmp_path / "depth.png", scene)
    assert Image.open(tmp_path / "film.png").size == (12 + 2 * 452, 56 + 275 + 34 + 12)
    assert Image.open(tmp_path / "depth.png").size[1] == 40 + 512 + 12


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_every_workcell_and_fixed_bodies_are_drawn(tmp_path: Path, workcell: Workcell) -> None:
    objects = [SceneObject("blue", "box", (0.05, 0.1, 0.1), (0.0, 0.3), 0.0)]
    goal = OnRegion("blue", Region((0.35, 0.25), 0.3, (0.12, 0.12)))
    wall = FixedBody("wall", "box", (0.6, 0.03, 0.3), (0.0, 0.6, 0.15), 0.2)
    scenes = [make_scene(objects, goal, workcell, fixed) for fixed in ([], [wall])]
    films = []
    for scene in scenes:
        save_film(tmp_path / "film.png", scene, ["grasp"], swing(scene, 10, (5,)))
        save_depth_picture(tmp_path / "depth.png", scene)
        films.append(np.asarray(Image.open(tmp_path / "film.png").convert("RGB")).astype(int))
    assert (np.abs(films[0] - films[1]).max(axis=2) > 20).sum() > 1000
