"""Arguments of a wrong type end with one sentence that says what was given and what would be valid."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dvr_jax as dvr
from dvr_jax.errors import DvrError, OptionError
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject

SCENE = Scene(
    (SceneObject("a", "box", (0.05, 0.15, 0.1), (-0.2, 0.1), 0.3),),
    OnRegion("a", Region((-0.1, -0.2), 0.2, (0.22, 0.22))),
)
ACTIONS = ["grasp(left, +x, a)", "place(left, a, goal)"]

REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "a path in place of a scene": (
        lambda: dvr.plan("a.json"),  # type: ignore[arg-type]
        "the scene is the path 'a.json'; valid is a Scene, as load_scene('a.json') returns it.",
    ),
    "a Path in place of a scene": (
        lambda: dvr.feasibility(Path("a.json"), []),  # type: ignore[arg-type]
        "the scene is the path 'a.json'; valid is a Scene",
    ),
    "a parsed file in place of a scene": (
        lambda: dvr.plan({"version": 1}),  # type: ignore[arg-type]
        "the scene is a dict; valid is a Scene",
    ),
    "scenes in place of one": (
        lambda: dvr.plan([SCENE, SCENE]),  # type: ignore[arg-type]
        "the scene is a list of 2 scenes; valid is one Scene a call.",
    ),
    "an iterator of scenes": (
        lambda: dvr.plan(dvr.sample_scenes(1)),  # type: ignore[arg-type]
        "the scene is of the type generator; valid is a Scene",
    ),
    "half an action": (
        lambda: dvr.plan(SCENE, k_max=2.5),
        "k_max is 2.5; valid is a whole number from 1 to 50.",
    ),  # type: ignore[arg-type]
    "too many actions": (
        lambda: dvr.plan(SCENE, k_max=10**12),
        "k_max is 1000000000000; valid is a whole number from 1 to 50.",
    ),
    "no action": (
        lambda: dvr.plan(SCENE, k_max=0),
        "k_max is 0; valid is a whole number from 1 to 50.",
    ),
    "a truth value": (
        lambda: dvr.plan(SCENE, k_max=True),
        "k_max is True; valid is a whole number from 1 to 50.",
    ),
    "a text as seed": (
        lambda: dvr.plan(SCENE, seed="a"),  # type: ignore[arg-type]
        "the seed is the text 'a'; valid is a whole number from 0.",
    ),
    "a negative seed": (
        lambda: dvr.plan(SCENE, seed=-1),
        "the seed is -1; valid is a whole number from 0.",
    ),
    "a text as time limit": (
        lambda: dvr.plan(SCENE, time_limit="10"),  # type: ignore[arg-type]
        "the time limit is the text '10'; valid is a positive number.",
    ),
    "no time": (
        lambda: dvr.plan(SCENE, time_limit=0),
        "the time limit is 0.0 s; valid is a positive number.",
    ),
    "a time that is no number": (
        lambda: dvr.plan(SCENE, time_limit=float("nan")),
        "the time limit is nan s",
    ),
    "an unknown search": (
        lambda: dvr.plan(SCENE, "dfs"),
        "there is no search 'dfs'; valid: dvr, classifier, mbts, bfs.",
    ),
    "an image in place of a network": (
        lambda: dvr.plan(SCENE, network=np.zeros((64, 64))),  # type: ignore[arg-type]
        "the network is an array of shape (64, 64); valid is a Predictor, as Predictor.load returns it",
    ),
    "a class in place of a network": (
        lambda: dvr.plan(SCENE, network=dvr.Predictor),  # type: ignore[arg-type]
        "the network is the class Predictor; valid is an instance, as its load returns it.",
    ),
    "a path in place of a network": (
        lambda: dvr.plan(SCENE, network=Path("network.npz")),  # type: ignore[arg-type]
        "the network is PosixPath('network.npz'); valid is a Predictor",
    ),
    "one text in place of sequences": (
        lambda: dvr.feasibility(SCENE, ACTIONS[0]),
        "the list of sequences is the text 'grasp(left, +x, a)'; valid is a list of sequences",
    ),
    "one sequence in place of sequences": (
        lambda: dvr.feasibility(SCENE, ACTIONS),
        "sequence 1 is the single action 'grasp(left, +x, a)'; valid is a list of sequences",
    ),
    "a number in place of an action": (
        lambda: dvr.feasibility(SCENE, [ACTIONS, [ACTIONS[0], 3]]),  # type: ignore[list-item]
        "action 2 of sequence 2 is 3; valid is a sequence of actions",
    ),
    "one text in place of actions": (
        lambda: dvr.check(SCENE, ACTIONS[0], None),  # type: ignore[arg-type]
        "the list of actions is the text 'grasp(left, +x, a)'; valid is a sequence of actions",
    ),
    "no motion": (
        lambda: dvr.check(SCENE, ACTIONS, None),  # type: ignore[arg-type]
        "the motion is None; valid is a Motion, such as a plan's.",
    ),
    "a number of scenes as text": (
        lambda: dvr.sample_scenes("3"),  # type: ignore[arg-type]
        "number is '3'; valid is a whole number.",
    ),
    "half an object": (
        lambda: dvr.sample_scenes(3, objects=1.5),  # type: ignore[arg-type]
        "objects is 1.5; valid is a whole number.",
    ),
    "a shape in place of a distribution": (
        lambda: dvr.sample_scenes(3, distribution="mixed"),  # type: ignore[arg-type]
        "distribution is of the type str; valid is a SceneDistribution.",
    ),
}


@pytest.mark.parametrize("given", REFUSED)
def test_a_wrong_argument_is_refused_in_one_sentence(given: str) -> None:
    call, message = REFUSED[given]
    with pytest.raises(OptionError) as refused:
        call()
    said = str(refused.value)
    assert said.startswith(message)
    assert said.endswith(".") and "\n" not in said and len(said) < 250


def test_wrong_numbers_of_scenes_and_objects_are_refused() -> None:
    with pytest.raises(DvrError, match="the number of scenes is 0"):
        dvr.sample_scenes(0)
    with pytest.raises(DvrError, match="the number of objects is 9"):
        dvr.sample_scenes(1, objects=9)


def test_numpy_numbers_are_numbers() -> None:
    scenes = list(dvr.sample_scenes(np.int64(2), seed=np.int32(7)))  # type: ignore[arg-type]
    assert scenes == list(dvr.sample_scenes(2, seed=7))
    assert [len(scene.objects) for scene in scenes] == [2, 2]
