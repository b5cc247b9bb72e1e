"""Sampled scenes: valid, reproducible one by one, within their ranges, half of the targets occupied."""

import dataclasses
import math

import numpy as np
import pytest

from dvr_jax.errors import DvrError, SceneError
from dvr_jax.geometry.footprint import contains_point, inside
from dvr_jax.scene.files import (
    OnRegion,
    Region,
    Scene,
    SceneObject,
    make_scene,
    scene_from_json,
    scene_to_json,
    validate_scene,
)
from dvr_jax.scene.fixed_sampling import add_fixed_bodies
from dvr_jax.scene.mjcf import build_home_data, build_model, require_free_home
from dvr_jax.scene.sampling import (
    DEFAULT_DISTRIBUTION,
    SceneDistribution,
    sample_scene,
    sample_scenes,
)
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, WORKCELLS, Arm, Table, Workcell


def occupied(scene: Scene) -> bool:
    """Whether the center of an object that is not the goal's lies on the target."""
    others = [item for item in scene.objects if item.name != scene.goal.object]
    return any(contains_point(item.position, scene.goal.region.footprint) for item in others)


@pytest.mark.parametrize("number_of_objects", [1, 2, 5, 8])
@pytest.mark.parametrize("shape", ["box", "cylinder", "mixed"])
def test_scenes_are_valid_and_within_ranges(number_of_objects: int, shape: str) -> None:
    distribution = SceneDistribution(shape=shape)  # type: ignore[arg-type]
    bases = [arm.position for arm in DEFAULT_WORKCELL.arms]
    for scene in sample_scenes(12, number_of_objects, 3, distribution):
        validate_scene(scene)
        assert scene_from_json(scene_to_json(scene)) == scene
        assert len(scene.objects) == number_of_objects
        goal = scene.objects[scene.goal_index]
        assert 2 * min(goal.half_extents[:2]) <= PANDA.maximum_opening  # it can be grasped at all
        assert not inside(goal.footprint, scene.goal.region.footprint)
        longest = 2 * max(goal.half_extents[:2])
        low, high = distribution.target_margin
        assert low <= scene.goal.region.size[0] - longest <= high
        for item in scene.objects:
            assert shape in ("mixed", item.shape)
            low, high = distribution.cube_side if len(set(item.size)) == 1 else distribution.height
            assert low <= item.height <= high
            near, far = distribution.base_distance
            assert near <= min(math.dist(item.position, base) for base in bases) <= far


def test_a_longer_draw_begins_with_the_shorter() -> None:
    short, long = list(sample_scenes(3, 2, 7)), list(sample_scenes(6, 2, 7))
    assert long[:3] == short
    assert len(set(long)) == 6
    assert list(sample_scenes(3, 2, 8)) != short
    assert list(sample_scenes(3, 2, 7)) == short


def test_half_of_the_targets_are_occupied() -> None:
    shares = [
        np.mean(
            [
                occupied(scene)
                for scene in sample_scenes(300, 2, 1, SceneDistribution(occupied_share=share))
            ]
        )
        for share in (0.0, 0.5, 1.0)
    ]
    assert shares[0] < 0.08 and 0.42 < shares[1] < 0.62 and shares[2] == 1.0


def test_a_share_of_the_boxes_are_cubes() -> None:
    distribution = SceneDistribution(cube_share=0.4)
    low, high = distribution.cube_side
    boxes = [item for scene in sample_scenes(300, 2, 1, distribution) for item in scene.objects]
    cubes = [box for box in boxes if len(set(box.size)) == 1]
    assert all(low <= cube.height <= high for cube in cubes)
    assert all(box.height >= distribution.height[0] for box in boxes if box not in cubes)
    assert 0.35 < len(cubes) / len(boxes) < 0.5


def test_no_object_touches_an_arm_at_home() -> None:
    for scene in sample_scenes(20, 3, 2):
        model = build_model(scene)
        data = build_home_data(model)
        assert all("table" in {model.geom(g).name for g in pair} for pair in data.contact.geom)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": (0.1, -0.1)}, "range x is"),
        ({"height": (math.nan, 0.1)}, "range height is"),
        ({"shape": "ball"}, "shape is 'ball'; valid are box, cylinder, mixed"),
        ({"occupied_share": 1.5}, "occupied share is 1.5"),
        ({"cube_share": -0.1}, "cube share is -0.1"),
        ({"base_distance": (5.0, 6.0)}, "no point with x"),
        ({"fixed_bodies": (2, 1)}, "range fixed_bodies is"),
        ({"fixed_bodies": (-1, 1)}, "fixed_bodies is .*; valid are whole numbers from 0 to 16"),
        ({"fixed_bodies": (0, 17)}, "fixed_bodies is .*; valid are whole numbers from 0 to 16"),
        ({"fixed_bodies": (0.5, 1.5)}, "fixed_bodies is .*; valid are whole numbers from 0 to 16"),
        (
            {"wide_side": (0.04, 3.0), "narrow_side": (3.0, 3.0), "cube_share": 0.0},
            "none of 5000 scenes",
        ),
    ],
)
def test_refuses_distributions(change: dict[str, object], message: str) -> None:
    distribution = dataclasses.replace(DEFAULT_DISTRIBUTION, **change)  # type: ignore[arg-type]
    with pytest.raises(DvrError, match=message):
        sample_scene(np.random.default_rng(0), 2, distribution)


@pytest.mark.parametrize(
    ("number", "objects", "seed", "message"),
    [
        (0, 2, 0, "number of scenes is 0"),
        (1, 0, 0, "objects is 0"),
        (1, 9, 0, "objects is 9"),
        (1, 2, -1, "seed is -1"),
    ],
)
def test_refuses_requests(number: int, objects: int, seed: int, message: str) -> None:
    with pytest.raises(DvrError, match=message):
        sample_scenes(number, objects, seed)


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_scenes_of_every_workcell(workcell: Workcell) -> None:
    scenes = list(sample_scenes(30, 2, 4, workcell=workcell))
    assert len(set(scenes)) == 30
    low, high = DEFAULT_DISTRIBUTION.base_distance
    for scene in scenes:
        validate_scene(scene)
        require_free_home(scene)
        assert scene.workcell == workcell and not scene.fixed
        assert scene_from_json(scene_to_json(scene)) == scene
        for position in [item.position for item in scene.objects] + [scene.goal.region.position]:
            assert low <= min(math.dist(position, arm.position) for arm in workcell.arms) <= high


@pytest.mark.parametrize(
    ("name", "number"), [("facing", (1, 3)), ("single", (1, 3)), ("side-by-side", (4, 8))]
)
def test_scenes_with_fixed_bodies(name: str, number: tuple[int, int]) -> None:
    """They are those without fixed bodies, and some more stands in them."""
    distribution = SceneDistribution(fixed_bodies=number)
    scenes = list(sample_scenes(30, 2, 5, distribution, WORKCELLS[name]))
    without = list(sample_scenes(30, 2, 5, workcell=WORKCELLS[name]))
    assert [dataclasses.replace(scene, fixed=()) for scene in scenes] == without
    low, high = number
    counts = [len(scene.fixed) for scene in scenes]
    assert min(counts) == low and max(counts) <= high and len(set(counts)) > 2
    kinds = {body.name.rstrip("0123456789") for scene in scenes for body in scene.fixed}
    assert kinds == {"wall", "board", "rim"}
    for scene in scenes:
        validate_scene(scene)
        require_free_home(scene)
        assert scene_from_json(scene_to_json(scene)) == scene
        assert all(inside(body.footprint, scene.workcell.table.footprint) for body in scene.fixed)


def test_a_full_table_has_no_place_for_fixed_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dvr_jax.scene.fixed_sampling.MOST_DRAWS", 20)
    with pytest.raises(SceneError, match=r"fixed bodies found a free place"):
        add_fixed_bodies(np.random.default_rng(0), full_scene(), (1, 1))


def full_scene() -> Scene:
    """A small table between two blocks, one of which the arm at home touches: nothing that is added is valid."""
    workcell = Workcell((Arm("arm", (0.0, 0.0), 0.0),), table=Table((0.22, 0.22)))
    blocks = [
        SceneObject(str(i), "box", (0.05, 0.44, 2.0), (x, 0.0), 0.0)
        for i, x in enumerate((-0.195, 0.195))
    ]
    return make_scene(blocks, OnRegion("0", Region((0.0, 0.0), 0.0, (0.05, 0.44))), workcell)
