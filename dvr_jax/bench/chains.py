"""Reach random goals one after the other, each from the scene that the last plan has left behind.

A new goal moves one object to a region. The earlier goals of the other objects stay part of the goal, so that a plan
must not undo them. A goal that would be met already is not drawn, nor one whose region has no room.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import tyro

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import inside
from dvr_jax.goals import Goal, HandsEmpty, On, Region
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.search.searches import SEARCHES

REGIONS = (
    Region((-0.35, -0.3), 0.0, (0.25, 0.25), name="left_front"),
    Region((-0.35, 0.3), 0.0, (0.25, 0.25), name="left_back"),
    Region((0.0, 0.0), 0.0, (0.25, 0.25), name="middle"),
    Region((0.35, -0.3), 0.0, (0.25, 0.25), name="right_front"),
    Region((0.35, 0.3), 0.0, (0.25, 0.25), name="right_back"),
)
"""The regions of all goals; each has room for two objects."""

OBJECTS = (
    SceneObject("red", "box", (0.06, 0.06, 0.12), (-0.35, 0.0), 0.0),
    SceneObject("blue", "box", (0.05, 0.09, 0.1), (0.35, 0.0), 0.4),
    SceneObject("green", "box", (0.06, 0.07, 0.15), (0.0, 0.35), -0.3),
)
"""The objects, where they stand before the first goal."""

MOST_ON_REGION = 2
"""Largest number of objects that goals ask for on one region."""

REACH = 0.003
"""A goal counts as kept if the footprint reaches over the region's edge by no more than this [m]."""


@dataclass(frozen=True)
class ChainsOptions:
    """Reach random goals one after the other, each from the scene that the last plan has left behind."""

    number: int = 50
    """Goals."""
    seed: int = 1
    """Of the goals."""
    search: str = "dvr"
    """dvr, classifier, mbts or bfs."""
    time_limit: float = 60.0
    """For each goal [s]."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option is out of its range, or there is no such search.
        """
        if self.number < 1:
            raise DvrError(f"--number is {self.number}; valid is 1 or more.")
        if self.seed < 0:
            raise DvrError(f"--seed is {self.seed}; valid is 0 or more.")
        if not self.time_limit > 0:
            raise DvrError(f"--time-limit is {self.time_limit}; valid is a positive number.")
        if self.search not in SEARCHES:
            raise DvrError(f"there is no search {self.search!r}; valid: {', '.join(SEARCHES)}.")


@dataclass
class ChainFigures:
    """What became of the goals of a chain."""

    solved: int = 0
    """Goals that were reached."""
    refused: int = 0
    """Scenes that a plan has left behind and that were refused as the next start."""
    undone: int = 0
    """Earlier goals that did not hold any more after a plan."""
    seconds: tuple[float, ...] = ()
    """Time of each plan [s]."""
    actions: tuple[int, ...] = ()
    """Number of actions of each plan."""


def run(arguments: list[str]) -> int:
    """Reach the goals and print the figures."""
    options = tyro.cli(ChainsOptions, prog="python -m dvr_jax.bench chains", args=arguments)
    options.check()
    figures = follow_chain(options)
    print(f"{options.number} goals in succession, seed {options.seed}, {options.search}:")
    print(f"  reached: {figures.solved}")
    print(f"  ends of plans refused as the next start: {figures.refused}")
    print(f"  earlier goals undone: {figures.undone}")
    if figures.seconds:
        print(
            f"  seconds: median {statistics.median(figures.seconds):.2f}, at most {max(figures.seconds):.2f}; "
            f"actions: {sum(figures.actions)} in all"
        )
    return 0


def follow_chain(options: ChainsOptions) -> ChainFigures:
    """Plan the goals of a chain one after the other.

    A goal that is not reached is given up, and the chain goes on from the same scene.
    """
    generator = np.random.default_rng(options.seed)
    figures = ChainFigures()
    wanted: dict[str, str] = {}
    scene = make_scene(OBJECTS, goal_of({"red": "middle"}), regions=REGIONS)

    for number in range(options.number):
        asked = next_goal(generator, wanted)
        goal = replace(scene, goal=goal_of(asked))
        found = plan(goal, options.search, time_limit=options.time_limit)
        figures.seconds += (found.seconds["total"],)
        figures.actions += (len(found.actions),)
        print(
            f"  goal {number}: {goal.goal.sentence()}: {found.status}", file=sys.stderr, flush=True
        )
        if not found.solved:
            continue

        figures.solved += 1
        after = _scene_after(found)
        if after is None:
            figures.refused += 1
            continue
        scene = after
        wanted = asked
        figures.undone += sum(not _stands_on(scene, *item) for item in wanted.items())
    return figures


def goal_of(wanted: Mapping[str, str]) -> Goal:
    """Return the goal that objects are on regions and all hands are empty.

    Args:
        wanted: The region of each object.
    """
    return Goal((*(On(item, region) for item, region in wanted.items()), HandsEmpty()))


def next_goal(generator: np.random.Generator, wanted: Mapping[str, str]) -> dict[str, str]:
    """Return the regions of all objects with a goal so far, with a new one for one object.

    Args:
        generator: Where random numbers come from.
        wanted: The regions so far.
    """
    while True:
        item = OBJECTS[generator.integers(len(OBJECTS))].name
        region = REGIONS[generator.integers(len(REGIONS))].name
        taken = [other for name, other in wanted.items() if name != item]
        if wanted.get(item) != region and taken.count(region) < MOST_ON_REGION:
            return {**wanted, item: region}


def _scene_after(found: Plan) -> Scene | None:
    """Return the scene that a plan leaves behind; None if it is refused."""
    try:
        return found.scene_after()
    except DvrError as error:
        print(f"  refused: {error}", file=sys.stderr, flush=True)
        return None


def _stands_on(scene: Scene, item: str, region: str) -> bool:
    """Return whether an object stands within a region."""
    footprint = scene.objects[scene.object_index(item)].footprint
    return inside(footprint, scene.region(region).footprint, REACH)
