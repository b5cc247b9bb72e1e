"""The network's predictions for a goal of one fact are those for the same scene with the paper's goal."""

from dataclasses import replace

import numpy as np
import pytest

import dvr_jax as dvr
from dvr_jax.goals import Clear, Goal, HandsEmpty, Inside, On, OnRegion, Region
from dvr_jax.model.predictor import load_network
from dvr_jax.operators import OPERATORS, ground_scene
from dvr_jax.scene.types import Scene
from dvr_jax.scene.validation import make_scene
from dvr_jax.search.one_fact import OneFactNetwork, only_fact
from dvr_jax.search.warm import Programs, query

RED = dvr.SceneObject("red", "box", (0.06, 0.1, 0.12), (-0.3, 0.2), 0.3)
BLUE = dvr.SceneObject("blue", "box", (0.06, 0.08, 0.1), (0.3, -0.2), 0.0)
SPOT = Region((0.1, 0.2), 0.2, (0.2, 0.2), name="spot")
OTHER = Region((-0.3, -0.3), 0.0, (0.2, 0.2), name="other")


def scene_for(*facts: object, objects: tuple[dvr.SceneObject, ...] = (RED, BLUE)) -> Scene:
    return make_scene(objects, Goal(facts), regions=[SPOT, OTHER])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("facts", "is_one"),
    [
        ((On("red", "spot"),), True),
        ((On("red", "spot"), HandsEmpty()), True),
        ((On("red", "spot"), On("blue", "other")), False),
        ((On("red", "spot"), Clear("other")), False),
        ((HandsEmpty(), Clear("other")), False),
    ],
)
def test_goals_of_one_object_on_a_region_are_found(facts: tuple[object, ...], is_one: bool) -> None:
    assert (only_fact(scene_for(*facts)) is not None) == is_one


def test_a_crowded_region_is_left_to_the_search_for_several_facts() -> None:
    small = [
        dvr.SceneObject(name, "box", (0.04, 0.04, 0.05), (x, 0.2), 0.0)
        for name, x in (("one", 0.05), ("two", 0.14))
    ]
    assert only_fact(scene_for(On("red", "spot"), objects=(RED, BLUE, small[0]))) is not None
    assert only_fact(scene_for(On("red", "spot"), objects=(RED, BLUE, *small))) is None


def test_predictions_are_those_for_the_paper_s_goal() -> None:
    network = load_network("dvr")
    scene = scene_for(On("red", "spot"), HandsEmpty())
    paper = replace(
        scene, goal=OnRegion("red", replace(SPOT, name="goal", inside=Inside.FOOTPRINT)), regions=()
    )
    grounding = ground_scene(scene)
    known = ground_scene(paper)

    ours = OneFactNetwork(network, OPERATORS)
    encoding = ours.encode_scene(scene, grounding)
    expected = network.encode_scene(paper, known)
    actions = [
        index
        for index in grounding.applicable(grounding.initial_state)
        if "grasp" in str(grounding.actions[index])
    ]
    assert actions
    numbers = [known.index(grounding.actions[index]) for index in actions]
    found, _ = ours.predict(encoding, encoding.initial_hidden(), actions)
    wanted, _ = network.predict(expected, expected.initial_hidden(), numbers)
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert np.ptp(found) > 0.1


@pytest.mark.parametrize(
    "facts",
    [
        (On("red", "spot"), HandsEmpty()),
        (On("red", "spot"), On("blue", "other")),
    ],
)
def test_the_network_s_programs_are_prepared_for_every_goal(facts: tuple[object, ...]) -> None:
    scene = scene_for(*facts)
    query(Programs(scene, 2, OPERATORS), scene, load_network("dvr"))
