"""Objects that exclude all placements on a region, against placements on a fine grid."""

import math
from dataclasses import replace

import numpy as np
import pytest
from relaxation_cases import box, obstructed

from dvr_jax.geometry.footprint import inside, signed_distance
from dvr_jax.logic import Action
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.search.obstruction import MARGIN, obstructions, overlap_of_all_placements
from dvr_jax.search.tree import SequenceTree


def least_overlap(scene: Scene, item: SceneObject, other: SceneObject) -> float:
    """The least overlap of placements on a grid of positions and yaws [m]; negative if one is apart."""
    region = scene.goal.region.footprint
    axes = region.axes()
    overlaps = []
    for u in np.linspace(-1, 1, 13):
        for v in np.linspace(-1, 1, 13):
            x, y = np.asarray(region.center) + np.array([u, v]) * region.half @ axes
            for yaw in np.linspace(0, math.pi, 13)[:-1]:
                placed = replace(item, position=(float(x), float(y)), yaw=region.yaw + float(yaw))
                if inside(placed.footprint, region):
                    overlaps.append(-signed_distance(placed.footprint, other.footprint))
    return min(overlaps, default=math.inf)


@pytest.mark.parametrize("index", range(12))
def test_the_overlap_is_a_lower_bound(index: int) -> None:
    scene = scene_of_seed(6, index, 2)
    item = scene.objects[scene.goal_index]
    (other,) = (each for each in scene.objects if each is not item)
    bound = overlap_of_all_placements(item, scene.goal.region.footprint, other)
    assert bound <= least_overlap(scene, item, other) + 1e-9


def test_boxes_on_a_small_target_are_obstructions() -> None:
    # The third box stands in a corner of the target, which the disc of the larger box may not reach.
    scene = obstructed(3)
    found = obstructions(scene, "target", "goal")
    assert set(found) == {"b1", "b2"} and all(overlap > MARGIN for overlap in found.values())
    aside = box("b1", (0.03, 0.03, 0.05), (-0.32, 0.17))
    moved = replace(scene, objects=(scene.objects[0], aside, *scene.objects[2:]))
    assert set(obstructions(moved, "target", "goal")) == {"b2"}


def test_a_place_is_refuted_until_the_obstruction_has_moved() -> None:
    tree = SequenceTree(obstructed(1), 4)
    texts = ["grasp(left, +x, b1)", "place(left, b1, table)", "grasp(left, +x, target)"]
    place = Action.parse("place(left, target, goal)")
    actions = list(map(Action.parse, texts))
    assert tree.relaxation.obstruction([actions[-1], place]) == "b1"
    assert tree.relaxation.obstruction([*actions, place]) is None
    on_table = Action.parse("place(left, target, table)")
    assert tree.relaxation.obstruction([actions[-1], on_table]) is None
