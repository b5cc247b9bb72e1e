"""How deep the arms as they are drawn get into what plans keep their collision capsules clear of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.checker.replay import DEEPEST_CONTACT
from dvr_jax.errors import DvrError
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.planner import plan
from dvr_jax.scene.mjcf import COLLISION_GROUP, LOOKS_GROUP, build_model_spec
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL

_FIXED_LINKS = {"base", "link1"}
"""Links that stand on the table."""

_GRIPPER_LINKS = {"hand", "finger_left", "finger_right"}
"""Links that may touch objects."""

TIME_LIMIT = 60.0
"""For each scene [s]."""


@dataclass(frozen=True)
class DrawnOptions:
    """Plan sampled scenes and replay the motions with the arms' drawn links in place of their capsules."""

    number: int = 80
    """Scenes of two boxes."""
    seed: int = 1
    """Of the scenes."""
    out: Path | None = None
    """JSON file to write the counts to."""


def run(arguments: list[str]) -> int:
    """Print the deepest penetration of each plan's drawn links that is deeper than the check allows."""
    options = tyro.cli(DrawnOptions, prog="python -m dvr_jax.bench drawn", args=arguments)
    if options.number < 1 or options.seed < 0:
        raise DvrError(
            f"--number is {options.number}, --seed {options.seed}; valid are 1 or more and 0 or more."
        )

    # One number a plan: its deepest penetration [m].
    deepest: list[float] = []
    for index, scene in enumerate(sample_scenes(options.number, 2, options.seed)):
        result = plan(scene, time_limit=TIME_LIMIT)
        if result.motion is None:
            continue

        depths = drawn_penetrations(scene, result.motion)
        deepest.append(max(depths.values(), default=0.0))
        for pair, depth in depths.items():
            if depth > DEEPEST_CONTACT:
                print(
                    f"  scene {index}: {' and '.join(pair)} {1e3 * depth:.1f} mm",
                    flush=True,
                )

    too_deep = sum(depth > DEEPEST_CONTACT for depth in deepest)
    deepest_of_all = 1e3 * max(deepest, default=0.0)
    limit = 1e3 * DEEPEST_CONTACT
    print(
        f"of {len(deepest)} plans, {too_deep} have a drawn link deeper than {limit:.0f} mm in something"
    )
    print(f"deepest {deepest_of_all:.1f} mm")

    if options.out is not None:
        metrics = [
            Metric("plans", len(deepest), "plans", Direction.HIGHER),
            Metric("plans with a link too deep", too_deep, "plans", Direction.LOWER),
            Metric("deepest penetration", deepest_of_all, "mm", Direction.LOWER),
            Metric("penetration that the check allows", limit, "mm", Direction.EQUAL),
        ]
        save_metrics(options.out, "drawn", metrics)
    return 0


def drawn_penetrations(scene: Scene, motion: Motion) -> dict[tuple[str, str], float]:
    """Measure the deepest penetration of each pair of bodies that should not touch.

    One body of a pair is an arm's drawn link, the other is the table, an object or a link of the other arm. Grippers
    may touch objects; an arm's base and first link may touch the table.

    Args:
        scene: the scene of the motion.
        motion: the motion, whose every state is looked at.

    Returns:
        Penetration [m] by the names of the two bodies, in alphabetical order.
    """
    model = _build_drawn_model(scene)
    data = mujoco.MjData(model)
    depths: dict[tuple[str, str], float] = {}

    for qpos in motion.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

        for contact in data.contact:
            first, second = sorted(
                model.body(model.geom_bodyid[geom]).name for geom in contact.geom
            )
            if _may_not_touch((first, second)):
                depth = -float(contact.dist)
                depths[first, second] = max(depths.get((first, second), 0.0), depth)
    return depths


def _build_drawn_model(scene: Scene) -> mujoco.MjModel:
    """Build the scene's model with drawn links that collide, in place of the capsules."""
    spec = build_model_spec(scene)
    for geom in spec.geoms:
        if geom.group in (LOOKS_GROUP, COLLISION_GROUP):
            collides = int(geom.group == LOOKS_GROUP)
            geom.contype = collides
            geom.conaffinity = collides
    model = spec.compile()

    # With several contacts a pair MuJoCo can report depths that are too small.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
    return model


def _may_not_touch(names: Sequence[str]) -> bool:
    """Whether a contact of two bodies counts as a penetration."""
    prefixes = [name.split("/")[0] for name in names]
    arms = [prefix if prefix in DEFAULT_WORKCELL.arm_names else "" for prefix in prefixes]
    links = {name.split("/")[-1] for name, arm in zip(names, arms, strict=True) if arm}

    # Contacts between things that are no arms, and within an arm, are not looked at.
    if not links or arms[0] == arms[1]:
        return False

    if any(name.startswith("object/") for name in names):
        return not links & _GRIPPER_LINKS

    # What is left is a link of each arm, or one link and the table.
    two_arms = "" not in arms
    return two_arms or not links & _FIXED_LINKS
