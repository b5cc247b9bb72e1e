"""How deep the arms as they are drawn get into what plans keep their collision capsules clear of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import tyro

from dvr_jax.checker.replay import DEEPEST_CONTACT
from dvr_jax.errors import DvrError
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.planner import plan
from dvr_jax.scene.mjcf import COLLISION_GROUP, LOOKS_GROUP, build_model_spec
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.constants import ARM_NAMES

_FIXED = {"base", "link1"}
"""Links that stand on the table."""
_GRIPPER = {"hand", "finger_left", "finger_right"}


@dataclass(frozen=True)
class DrawnOptions:
    """Plan sampled scenes and replay the motions with the arms' drawn links in place of their capsules."""

    number: int = 80
    """Scenes of two boxes."""
    seed: int = 1
    """Of the scenes."""


def run(arguments: list[str]) -> int:
    """Print the deepest penetration of each plan's drawn links that is deeper than the check allows."""
    options = tyro.cli(DrawnOptions, prog="python -m dvr_jax.bench drawn", args=arguments)
    if options.number < 1 or options.seed < 0:
        raise DvrError(f"--number is {options.number}, --seed {options.seed}; valid are 1 or more and 0 or more.")
    deepest: list[float] = []
    for index, scene in enumerate(sample_scenes(options.number, 2, options.seed)):
        result = plan(scene, time_limit=60.0)
        if result.motion is None:
            continue
        depths = drawn_penetrations(scene, result.motion)
        deepest.append(max(depths.values(), default=0.0))
        for pair, depth in depths.items():
            if depth > DEEPEST_CONTACT:
                print(f"  scene {index}: {' and '.join(pair)} {1e3 * depth:.1f} mm", flush=True)
    deep = sum(depth > DEEPEST_CONTACT for depth in deepest)
    print(f"of {len(deepest)} plans, {deep} have a drawn link deeper than {1e3 * DEEPEST_CONTACT:.0f} mm in something")
    print(f"deepest {1e3 * max(deepest, default=0.0):.1f} mm")
    return 0


def drawn_penetrations(scene: Scene, motion: Motion) -> dict[tuple[str, str], float]:
    """Deepest penetration [m] of each pair of bodies of which one is an arm's drawn link and the other is the table,
    an object or the other arm's; grippers may touch objects, an arm's base and first link the table."""
    spec = build_model_spec(scene)
    for geom in spec.geoms:
        if geom.group in (LOOKS_GROUP, COLLISION_GROUP):
            geom.contype = geom.conaffinity = int(geom.group == LOOKS_GROUP)
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD  # else depths can be told too small
    data = mujoco.MjData(model)
    depths: dict[tuple[str, str], float] = {}
    for qpos in motion.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            first, second = sorted(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)
            if _may_not_touch((first, second)):
                depths[first, second] = max(depths.get((first, second), 0.0), -float(contact.dist))
    return depths


def _may_not_touch(names: Sequence[str]) -> bool:
    arms = [name.split("/")[0] if name.split("/")[0] in ARM_NAMES else "" for name in names]
    links = {name.split("/")[-1] for name, arm in zip(names, arms, strict=True) if arm}
    if not links or arms[0] == arms[1]:
        return False
    if any(name.startswith("object/") for name in names):
        return not links & _GRIPPER
    return "" not in arms or not links & _FIXED
