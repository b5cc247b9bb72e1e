"""Files for robot controllers: set points at a fixed rate (CSV), and trajectories with the fields of ROS 2 messages."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from dvr_jax.motion.interpolation import spline_of
from dvr_jax.motion.motion import Motion
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.types import Scene

CSV_RATE = 1000.0
"""Rate of the set points of Franka's control interface [1/s]."""

GRIP_FORCE = 70.0
"""Largest force of a closing gripper in a command [N]: what Franka's hand holds continuously."""

SAME_TRAVEL = 1e-5
"""A finger rests while its travel changes by no more than this from one sample to the next [m]."""

NANOSECONDS = 1_000_000_000


def export_csv(path: Path, scene: Scene, motion: Motion, rate: float = CSV_RATE) -> None:
    """Write the set points of all joints and fingers as a table of comma-separated values.

    The first line names the columns: `time` [s], then for each arm its joints [rad] and the gap between its fingers
    [m].

    Args:
        path: Name of the file.
        scene: Scene of the motion.
        motion: The motion.
        rate: Number of lines for each second [1/s].

    Raises:
        OptionError: The rate is no number from 1 to 10,000.
        OSError: The file cannot be written.
    """
    layout = qpos_layout(scene)
    sampled = motion.sample(rate)
    names = ["time"]
    columns = [sampled.time - sampled.time[0]]
    for arm, name in enumerate(scene.workcell.arm_names):
        joints = layout.arm_joints[arm]
        names += [f"{name}/joint{number + 1}" for number in range(len(joints))]
        columns += list(sampled.qpos[:, joints].T)
        names.append(f"{name}/gap")
        columns.append(sampled.qpos[:, layout.fingers[arm]].sum(axis=1))
    table = np.stack(columns, axis=1)
    text = io.StringIO()
    np.savetxt(text, table, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    write_whole(path, text.getvalue().encode())


def export_ros(path: Path, scene: Scene, motion: Motion) -> None:
    """Write the trajectories of all arms and the commands of all grippers as JSON.

    `arms` has for each arm the fields of `trajectory_msgs/JointTrajectory`, with a point for each sample of the motion.
    `grippers` has for each arm a list of commands: `time_from_start`, when the fingers begin to move, and `command`
    with the fields of `control_msgs/GripperCommand`, where `position` is the gap between the fingers [m].

    Args:
        path: Name of the file.
        scene: Scene of the motion.
        motion: The motion.

    Raises:
        OSError: The file cannot be written.
    """
    layout = qpos_layout(scene)
    time = motion.time - motion.time[0]
    spline = spline_of(motion)
    velocity = spline(time, 1)
    acceleration = spline(time, 2)

    arms: dict[str, Any] = {}
    grippers: dict[str, Any] = {}
    for arm, name in enumerate(scene.workcell.arm_names):
        joints = layout.arm_joints[arm]
        arms[name] = {
            "header": {"stamp": _duration(0.0), "frame_id": ""},
            "joint_names": [f"{name}/joint{number + 1}" for number in range(len(joints))],
            "points": [
                {
                    "positions": motion.qpos[sample, joints].tolist(),
                    "velocities": velocity[sample, joints].tolist(),
                    "accelerations": acceleration[sample, joints].tolist(),
                    "effort": [],
                    "time_from_start": _duration(float(time[sample])),
                }
                for sample in range(len(time))
            ],
        }
        grippers[name] = _gripper_commands(time, motion.qpos[:, layout.fingers[arm]].sum(axis=1))
    write_whole(path, msgspec.json.encode({"arms": arms, "grippers": grippers}) + b"\n")


def _gripper_commands(
    time: Float[np.ndarray, " samples"], gap: Float[np.ndarray, " samples"]
) -> list[dict[str, Any]]:
    """Return one command for each motion of the fingers.

    Args:
        time: Times of the samples [s].
        gap: Gap between the fingers [m].
    """
    moves = np.abs(np.diff(gap)) > SAME_TRAVEL
    starts = np.flatnonzero(moves & ~np.append(False, moves[:-1]))
    ends = np.flatnonzero(moves & ~np.append(moves[1:], False)) + 1
    return [
        {
            "time_from_start": _duration(float(time[start])),
            "command": {
                "position": float(gap[end]),
                "max_effort": GRIP_FORCE if gap[end] < gap[start] else 0.0,
            },
        }
        for start, end in zip(starts, ends, strict=True)
    ]


def _duration(seconds: float) -> dict[str, int]:
    """Return a time with the fields of `builtin_interfaces/Duration`."""
    nanoseconds = round(seconds * NANOSECONDS)
    return {"sec": nanoseconds // NANOSECONDS, "nanosec": nanoseconds % NANOSECONDS}
