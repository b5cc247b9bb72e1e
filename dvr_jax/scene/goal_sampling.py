"""Random goals of several facts: some objects of a random scene shall stand on one region, and all hands be empty.

The region lies on the table, or on a bench that is put under it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import signed_distance
from dvr_jax.goals import Goal, GoalFact, HandsEmpty, On
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.start import goal_holds_at_start
from dvr_jax.scene.types import FixedBody, Region, Scene
from dvr_jax.scene.validation import validate_scene

PLATE = "plate"
"""Name of the region."""

FARTHEST = 0.8
"""Largest shift of the region along x and y [m]."""

TRIES = 400
"""Number of places of the region that are tried."""


BENCH = "bench"
"""Name of the fixed body under a raised region."""

BENCH_HEIGHT = (0.03, 0.25)
"""Heights of benches [m]."""

BENCH_BORDER = 0.02
"""How far a bench reaches beyond the region on each side [m]."""


def scene_with_goals(
    scene: Scene, goals: int, seed: tuple[int, int], raised: bool = False
) -> Scene:
    """Return a scene whose goal names several objects, made from one whose goal names one of them.

    The further objects are drawn. The region is larger than the one of the given scene. It is at the nearest of some
    random places where the scene is valid.

    Args:
        scene: A valid scene with the paper's goal.
        goals: Number of objects on the region, at least 1 and at most as many as the scene has.
        seed: Seed of the scenes, and the number of this one.
        raised: Whether the region lies on a bench of random height.

    Raises:
        SceneError: No place of the region makes a valid scene, or the scene has too few objects.
    """
    if not 1 <= goals <= len(scene.objects):
        raise SceneError(
            f"{goals} objects of {len(scene.objects)} are wanted on the region; valid are 1 to all."
        )

    generator = np.random.default_rng([*seed, goals])
    first = scene.paper_goal.object
    others = [name for name in scene.object_names if name != first]
    chosen = generator.permutation(others)[: goals - 1].tolist()
    facts: tuple[GoalFact, ...] = (*(On(name, PLATE) for name in (first, *chosen)), HandsEmpty())

    # Each object gets a square with the room beside it that the drawn region leaves to the first one.
    drawn = scene.paper_goal.region
    longest = {item.name: 2 * max(item.half_extents[:2]) for item in scene.objects}
    spare = max(drawn.size[0] - longest[first], 0.0)
    side = math.sqrt(sum((longest[name] + spare) ** 2 for name in (first, *chosen)))
    plate = replace(drawn, name=PLATE, size=(side, side))
    shifts = np.concatenate([np.zeros((1, 2)), generator.uniform(-FARTHEST, FARTHEST, (TRIES, 2))])
    height = float(generator.uniform(*BENCH_HEIGHT)) if raised else 0.0
    for shift in sorted(shifts.tolist(), key=lambda shift: math.hypot(*shift)):
        x, y = np.add(drawn.position, shift).tolist()
        region = replace(plate, position=(x, y))
        made = replace(scene, goal=Goal(facts), regions=(region,))
        if raised:
            made = _on_bench(made, region, height)
            bench = made.fixed[-1].footprint
            if any(signed_distance(bench, body.footprint) < 0 for body in scene.fixed):
                continue
        try:
            validate_scene(made)
            if raised:
                require_free_home(made)
        except SceneError:
            continue
        if not goal_holds_at_start(made):
            return made
    raise SceneError(
        f"a region for {goals} objects finds no place in this scene; fewer of them give room."
    )


def _on_bench(scene: Scene, region: Region, height: float) -> Scene:
    """Return a scene whose region lies on a bench.

    Args:
        scene: A scene with this region alone.
        region: The region.
        height: Height of the bench [m].
    """
    sides = [side + 2 * BENCH_BORDER for side in region.size]
    center = (*region.position, height / 2)
    bench = FixedBody(BENCH, "box", (sides[0], sides[1], height), center, region.yaw)
    return replace(scene, fixed=(*scene.fixed, bench), regions=(replace(region, support=BENCH),))
