"""Do the reasons of refuted sequences hold? The scene is changed by what a reason states, and judged again.

What a reason names is removed or shrunk, or moved by the stated distance, and the refuted actions are judged with
another seed. The reason holds if they pass the bound that refuted them then: their keyframes exist, and also a path if
the path bound or the check has refuted them.
"""

from __future__ import annotations

import math
import random
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.errors import DvrError
from dvr_jax.goals import Region
from dvr_jax.logic import Action, enumerate_sequences
from dvr_jax.operators import OPERATORS, ground_scene, object_of
from dvr_jax.planning.feasibility import Verdict, feasibility
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.search.counterfactual import is_possible, move_object, shifted, without_body
from dvr_jax.search.reasons import Reason, ReasonKind, static_reason
from dvr_jax.search.work import run_alone

LENGTHS = (2, 3, 4)
"""Numbers of actions of the sequences."""

DRAWN = 12
"""Sequences that are drawn in each scene, of which at most `KEPT` refuted ones count."""

KEPT = 4
"""Refuted sequences of one scene, each refuted by other actions."""

PATH_BOUNDS = ("path", "check")
"""Bounds that refute sequences whose keyframes exist."""

SPARE = 2e-3
"""Added to a size by which something is shrunk or grown [m]."""


@dataclass(frozen=True)
class ReasonsOptions:
    """Judge random sequences, and see whether the reasons of the refuted ones hold."""

    number: int = 200
    """Refuted sequences."""
    objects: int = 2
    """Objects in each scene, 2 to 8."""
    seed: int = 6
    """Of the scenes and of the sequences."""
    confirm: bool = True
    """Confirm reasons as `feasibility(..., confirm_reasons=True)` does."""
    out: Path | None = None
    """JSON file to write the shares to."""


def run(arguments: list[str]) -> int:
    """Print the share of reasons that hold, by kind, by bound, and by whether they are confirmed."""
    options = tyro.cli(ReasonsOptions, prog="python -m dvr_jax.bench reasons", args=arguments)
    if options.number < 1 or options.seed < 0 or not 2 <= options.objects <= 8:
        raise DvrError(
            f"--number is {options.number}, --seed {options.seed}, --objects {options.objects}; "
            "valid are 1 or more, 0 or more, and 2 to 8."
        )
    drawn: Counter[str] = Counter()
    held: Counter[str] = Counter()
    for scene, verdict in draw_refuted(options):
        assert verdict.reason is not None
        is_right = holds(scene, verdict)
        state = "confirmed" if verdict.reason.confirmed else "not confirmed"
        for group in (verdict.reason.kind, f"bound {verdict.bound}", state):
            drawn[group] += 1
            held[group] += is_right
        mark = "holds" if is_right else "does not hold"
        print(f"  {mark}: {verdict.bound}: {verdict.reason}", file=sys.stderr, flush=True)

    right = held["confirmed"] + held["not confirmed"]
    share = right / options.number
    for group, count in sorted(drawn.items()):
        print(f"{group}: {held[group]} of {count} hold")
    print(f"all: {right} of {options.number} hold ({share:.0%})")
    if options.out is not None:
        save_metrics(
            options.out, "reasons", [Metric("reasons that hold", share, "", Direction.HIGHER)]
        )
    return 0


def draw_refuted(options: ReasonsOptions) -> Iterator[tuple[Scene, Verdict]]:
    """Yield scenes and verdicts on refuted sequences.

    Args:
        options: How many, and of which scenes.
    """
    count = 0
    index = 0
    while count < options.number:
        scene = scene_of_seed(options.seed, index, options.objects)
        generator = random.Random(f"{options.seed} {index}")
        index += 1
        verdicts = feasibility(
            scene, _draw_sequences(scene, generator), confirm_reasons=options.confirm
        )
        refuted = {v.refuted: v for v in verdicts if v.reason is not None}
        # Few sequences are refuted by the path bound alone; where there is one, it counts.
        ordered = sorted(refuted.values(), key=lambda v: v.bound not in PATH_BOUNDS)
        for verdict in ordered[: min(KEPT, options.number - count)]:
            count += 1
            yield scene, verdict


def _draw_sequences(scene: Scene, generator: random.Random) -> list[list[Action]]:
    """Draw sequences that reach the goal, as many of each length."""
    grounding = ground_scene(scene)
    drawn = []
    for length in LENGTHS:
        sequences = list(enumerate_sequences(grounding, length))
        for sequence in generator.sample(sequences, min(DRAWN // len(LENGTHS), len(sequences))):
            drawn.append([grounding.actions[index] for index in sequence])
    return drawn


def holds(scene: Scene, verdict: Verdict, seed: int = 17) -> bool:
    """Return whether refuted actions become possible if the scene is changed by what the reason states.

    Args:
        scene: A valid scene.
        verdict: A verdict with a reason.
        seed: Seed of the sampling.
    """
    reason = verdict.reason
    assert reason is not None
    if reason.kind in (ReasonKind.WIDTH, ReasonKind.FOOTPRINT) and verdict.bound == "symbolic":
        changed = _resized(scene, reason)
        return static_reason(changed, verdict.refuted[-1], OPERATORS) is None

    item = object_of(verdict.refuted[-1], OPERATORS)
    named = [name for name in reason.bodies if name != item]
    known = [*scene.object_names, *(body.name for body in scene.fixed)]
    actions = verdict.refuted
    if reason.kind == ReasonKind.REACH and math.isfinite(reason.amount):
        changed = _moved(scene, reason)
    elif reason.kind == ReasonKind.FOOTPRINT:
        changed = _resized(scene, reason)
    elif any(name in known for name in named) and reason.kind in (
        ReasonKind.COLLISION,
        ReasonKind.MOTION,
    ):
        name = next(name for name in named if name in known)
        changed = without_body(scene, name)
        actions = tuple(a for a in actions if object_of(a, OPERATORS) != name)
    else:
        return False
    has_motion = verdict.bound in PATH_BOUNDS
    with jax.enable_x64(True):
        steps = is_possible(changed, actions, seed, OPERATORS, has_motion)
        return bool(actions) and run_alone(steps)


def _moved(scene: Scene, reason: Reason) -> Scene:
    """Return a scene with an object or the region nearer to an arm by the amount of a reason."""
    arm_text, what = reason.bodies
    arm = scene.workcell.arms[scene.workcell.arm_index(arm_text.removesuffix(" arm"))]
    if what in scene.object_names:
        item = scene.objects[scene.object_index(what)]
        return move_object(scene, what, shifted(item.position, arm.position, -reason.amount))
    region = scene.paper_goal.region
    position = shifted(region.position, arm.position, -reason.amount)
    return replace(scene, goal=replace(scene.paper_goal, region=replace(region, position=position)))


def _resized(scene: Scene, reason: Reason) -> Scene:
    """Return a scene whose object is less wide, or whose region is larger, by the amount of a reason."""
    if reason.kind == ReasonKind.FOOTPRINT:
        width, depth = scene.paper_goal.region.size
        grown = reason.amount + SPARE
        region = Region(
            scene.paper_goal.region.position,
            scene.paper_goal.region.yaw,
            (width + grown, depth + grown),
        )
        return replace(scene, goal=replace(scene.paper_goal, region=region))
    name = reason.bodies[0]
    objects = tuple(
        _narrower(item, scene.workcell.robot.maximum_opening) if item.name == name else item
        for item in scene.objects
    )
    return replace(scene, objects=objects)


def _narrower(item: SceneObject, opening: float) -> SceneObject:
    """Return an object whose horizontal sizes are a little smaller than the opening of a gripper [m]."""
    least = opening - SPARE
    if item.shape == "cylinder":
        return replace(item, size=(min(item.size[0], least / 2), item.size[1]))
    x, y, z = item.size
    return replace(item, size=(min(x, least), min(y, least), z))
