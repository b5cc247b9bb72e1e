"""Plan sampled scenes and measure their motions: durations, limits, clearances of the meshes, heights, check times.

Every measure comes from an implementation that the planner does not use: `toppra`'s own constraints for the fastest
motion along a path, finite differences and MuJoCo's inverse dynamics for the limits, and `coal` with the meshes of the
robot's maker for the clearances.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass
from typing import Literal

import tyro

from dvr_jax.bench.mesh_distances import deepest_penetration, least_distances
from dvr_jax.bench.motion_limits import limit_uses
from dvr_jax.bench.motion_states import replay_states
from dvr_jax.bench.motion_table import print_by_length, print_distances
from dvr_jax.bench.motion_timing import time_motion
from dvr_jax.bench.placement import carried_height, goal_placement
from dvr_jax.bench.results_file import ResultsFile, Row
from dvr_jax.bench.robot_meshes import require_meshes
from dvr_jax.bench.scenes import (
    ScenesOptions,
    header_options,
    load_search_network,
    plan_scene,
    prepare_worker,
)
from dvr_jax.planning.check import check
from dvr_jax.planning.result import Plan
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.workcell.workcell import named_workcell

MILLI = 1e3
"""Millimeters in a meter, and milliseconds in a second."""

FINER = 4
"""Distances of meshes are computed at so many states for each sample of a motion."""


@dataclass(frozen=True)
class MotionsOptions(ScenesOptions):
    """Plan sampled scenes and measure their motions."""

    search: str = "dvr"
    """dvr, classifier, mbts or bfs."""
    termination: Literal["feasible", "optimal"] = "optimal"
    """Whether plans take the first feasible path or an optimal one."""
    meshes: bool = False
    """Whether distances of the robot's meshes are computed; needs pip install 'dvr_jax[meshes]'."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option is out of its range, or meshes are asked for and missing.
        """
        super().check()
        if self.meshes:
            require_meshes(named_workcell(self.workcell).robot)


def measure_plan(plan: Plan, meshes: bool) -> Row:
    """Measure the motion of a solved plan.

    Args:
        plan: The plan.
        meshes: Whether distances of the robot's meshes are computed.

    Returns:
        Entries of a row of the results file: times in s or ms, lengths in mm.

    Raises:
        DvrError: Meshes are asked for, and they are missing or a shape is unknown.
    """
    assert plan.motion is not None
    states = replay_states(plan.scene, plan.actions, plan.motion)
    timing = time_motion(states)
    placement = goal_placement(states)
    row: Row = {
        "duration": round(timing.duration, 3),
        "moving": round(timing.moving, 3),
        "limits": {
            name: {"ratio": round(use.ratio, 4), "joint": use.joint, "time": round(use.time, 3)}
            for name, use in limit_uses(states).items()
        },
        "check_ms": round(MILLI * _check_seconds(plan), 1),
        "edge_mm": round(MILLI * placement.edge, 3),
        "is_clear_of_edges": placement.is_clear,
    }

    # JSON has neither NaN nor infinity, so what does not exist is left out.
    optional = {
        "fastest": timing.fastest,
        "fastest_with_torque": timing.fastest_with_torque,
        "fastest_with_slow_hands": timing.fastest_with_slow_hands,
        "height_mm": MILLI * carried_height(states),
    }
    row |= {name: round(value, 3) for name, value in optional.items() if math.isfinite(value)}
    if meshes:
        row |= _measure_meshes(plan)
    return row


def _measure_meshes(plan: Plan) -> Row:
    """Return the entries of the distances of meshes [mm]."""
    assert plan.motion is not None
    finer = plan.motion.sample(FINER / plan.motion.step)
    least = least_distances(replay_states(plan.scene, plan.actions, finer))
    distances = {
        str(kind): {
            "mm": round(MILLI * found.distance, 3),
            "bodies": [found.first, found.second],
            "time": round(found.time, 3),
        }
        for kind, found in least.items()
    }
    return {
        "distances": distances,
        "penetration_mm": round(MILLI * deepest_penetration(least), 3),
    }


def _check_seconds(plan: Plan) -> float:
    """Return the wall time of the independent check of a plan [s]."""
    assert plan.motion is not None
    start = time.perf_counter()
    check(plan.scene, plan.actions, plan.motion)
    return time.perf_counter() - start


def _measure_one(options: MotionsOptions, index: int) -> Row:
    """Plan a scene and measure its motion; the row of the results file."""
    plan = plan_scene(options, index, options.termination)
    row: Row = {"scene": index, "status": str(plan.status), "length": len(plan.actions)}
    if plan.motion is not None:
        row |= measure_plan(plan, options.meshes)
    return row


def measure_scenes(options: MotionsOptions) -> Iterator[Row]:
    """Give the rows of all scenes, first those that the file has.

    Raises:
        DvrError: An option makes no sense, meshes are missing, or the file holds results of other options or of
            another version.
    """
    options.check()

    # The network is loaded here once, so that a bad file is refused before any worker starts.
    load_search_network(options.search, options.network)

    results_file = ResultsFile(options.out, header_options(options))
    todo = results_file.missing(options.number)
    yield from (row for index, row in results_file.rows.items() if index < options.number)
    if not todo:
        return

    with worker_processes(options.workers, prepare_worker, options) as pool:
        tasks = [pool.submit(_measure_one, options, index) for index in todo]
        for task in as_completed(tasks):
            row = task.result()
            results_file.add(row)
            outcome = f"{row['length']} actions in {row['duration']} s" if row["length"] else ""
            print(f"  scene {row['scene']}: {row['status']} {outcome}", file=sys.stderr, flush=True)
            yield row


def run(arguments: list[str]) -> int:
    """Plan the scenes, measure their motions, and print the tables."""
    options = tyro.cli(MotionsOptions, prog="python -m dvr_jax.bench motions", args=arguments)
    rows = list(measure_scenes(options))
    solved = [row for row in rows if row["length"]]
    print(
        f"{len(rows)} scenes of {options.objects} objects ({options.shape}, seed {options.seed}), {options.search}, "
        f"{options.termination} paths: {len(solved)} solved"
    )
    if solved:
        print_by_length(solved)
        if options.meshes:
            print_distances(solved)
    return 0
