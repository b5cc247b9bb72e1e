"""Random scenes as the public API offers them."""

from __future__ import annotations

import operator
from collections.abc import Iterator

from dvr_jax.errors import OptionError
from dvr_jax.scene import sampling
from dvr_jax.scene.goal_sampling import scene_with_goals
from dvr_jax.scene.sampling import DEFAULT_DISTRIBUTION, SceneDistribution
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell


def sample_scenes(
    number: int,
    objects: int = 2,
    seed: int = 0,
    distribution: SceneDistribution = DEFAULT_DISTRIBUTION,
    workcell: Workcell = DEFAULT_WORKCELL,
    goals: int = 1,
    raised: bool = False,
) -> Iterator[Scene]:
    """Draw random valid scenes, one after the other.

    Args:
        number: Number of scenes, at least 1.
        objects: Number of objects in each scene, 1 to 8.
        seed: Seed, from 0. Scene i of a seed is the same whatever `number` is.
        distribution: Shapes, ranges of sizes and positions, and number of fixed bodies.
        workcell: Arms and table of all scenes, for instance `WORKCELLS["single"]`.
        goals: Number of objects that shall stand on the region. With 1, the goal is the paper's; with more, all hands
            shall be empty too.
        raised: Whether the region lies on a bench of random height. Then all hands shall be empty in any case.

    Returns:
        An iterator over the scenes.

    Raises:
        OptionError: An argument has a wrong type.
        DvrError: An argument has a wrong value, or the distribution leaves no room for a valid scene.
    """
    number = _whole_number("number", number)
    objects = _whole_number("objects", objects)
    seed = _whole_number("seed", seed)
    if not isinstance(distribution, SceneDistribution):
        raise OptionError(
            f"distribution is of the type {type(distribution).__name__}; valid is a SceneDistribution."
        )
    if not isinstance(workcell, Workcell):
        raise OptionError(
            f"workcell is of the type {type(workcell).__name__}; valid is a Workcell."
        )

    goals = _whole_number("goals", goals)
    if not 1 <= goals <= objects:
        raise OptionError(f"goals is {goals}; valid is 1 to the number of objects, {objects}.")

    scenes = sampling.sample_scenes(number, objects, seed, distribution, workcell)
    if goals == 1 and not raised:
        return scenes
    return (
        scene_with_goals(scene, goals, (seed, index), raised) for index, scene in enumerate(scenes)
    )


def _whole_number(name: str, value: object) -> int:
    """Return a value as an int, also one of NumPy's; refuse what is no whole number."""
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise OptionError(f"{name} is {value!r}; valid is a whole number.") from None
