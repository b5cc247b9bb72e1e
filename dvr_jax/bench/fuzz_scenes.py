"""Damaged scene files: each is refused in one sentence, or is a valid scene that a planner can begin with."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from dvr_jax.bench.fuzz_damage import damage, damage_json, to_text
from dvr_jax.bench.fuzz_judge import Problem, Tally, judge
from dvr_jax.errors import DvrError
from dvr_jax.operators import ground_scene
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.random_scenes import sample_scenes
from dvr_jax.scene.sampling import SceneDistribution
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.workcell import WORKCELLS

BEGIN_EVERY = 20
"""Of the accepted scenes, one in so many is handed to the first steps of a plan, which take most of the time."""

BYTES_SHARE = 0.3
"""Share of the scenes whose bytes are damaged, and not their values."""


def intact_scenes(seed: int) -> list[Scene]:
    """Return scenes of all kinds of bodies and workcells, which are then damaged."""
    mixed = SceneDistribution(shape="mixed")
    crowded = SceneDistribution(shape="mixed", fixed_bodies=(1, 3))
    scenes = [
        *sample_scenes(4, 1, seed, mixed),
        *sample_scenes(6, 2, seed, mixed),
        *sample_scenes(4, 4, seed, mixed),
        *sample_scenes(3, 3, seed, crowded),
    ]
    for name in ("single", "side-by-side"):
        scenes += sample_scenes(2, 2, seed, crowded, WORKCELLS[name])
    return scenes


def fuzz_scenes(numbers: range, seed: int, tally: Tally) -> list[Problem]:
    """Damage and read scenes.

    Args:
        numbers: Numbers of the damaged scenes.
        seed: Seed of the damage.
        tally: Takes the cases.

    Returns:
        The cases that ended as none may.
    """
    texts = [scene_to_json(scene).encode() for scene in intact_scenes(seed)]
    problems = []

    for index in numbers:
        generator = np.random.default_rng([seed, 1, index])
        text = _damaged(texts[generator.integers(len(texts))], generator)
        begin = index % BEGIN_EVERY == 0
        wrong = judge(lambda text=text, begin=begin: _read(text, begin), "scene", tally)  # type: ignore[misc]
        if wrong is not None:
            problems.append(Problem("scene", index, wrong))

    return problems


def _damaged(text: bytes, generator: np.random.Generator) -> bytes:
    """Return the text of a scene with damaged bytes, or with damaged values."""
    if generator.random() < BYTES_SHARE:
        return damage(text, generator)

    record: Any = json.loads(text)
    return to_text(damage_json(record, generator))


def _read(text: bytes, begin: bool) -> str | None:
    """Read a scene and say what is wrong with it, if it is accepted."""
    scene = scene_from_json(text)
    again = scene_to_json(scene)
    if scene_from_json(again) != scene or scene_to_json(scene_from_json(again)) != again:
        return "what is written of it is another scene"

    if begin:
        try:
            require_free_home(scene)
        except DvrError:
            # The arms at home touch an object: refused before a plan begins.
            return None
        ground_scene(scene)
    return None
