"""Limits of the motion of hands, which keep them from pushing objects and objects from slipping out of them.

Servos lag behind where a motion is fast or accelerates much, and a hand that comes to an object passes it at a distance
of millimeters. A gripper holds by friction, so an object that is accelerated too much turns or slips between its pads.
The values were found by trial: ``python -m dvr_jax.bench execute`` measures how many executed plans succeed with them.

- **Speed.** A hand that takes or releases an object at a switch moves slowly near its pose there (`near_speed`).
- **Acceleration.** The center of a hand that takes part in the switch before or after a phase, or that holds an object,
  has a largest acceleration along each axis of the world. A held object lowers it by the moment of its weight about the
  axis through the pads, which is largest where it is held far from its center.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from dvr_jax.modes import held
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem
from dvr_jax.planning.carried_objects import gripper_frames
from dvr_jax.scene.layout import home_qpos, qpos_layout
from dvr_jax.scene.types import Scene

NEAR_SPEED = 0.25
"""Largest speed of a hand near its pose at a switch in which it takes part [m/s]."""

NEAR_DISTANCE = 0.01
"""Distance from this pose up to which it holds [m]."""

NEAR_ACCELERATION = 3.0
"""Beyond it, the largest speed is that of a hand that reaches the slow part at this deceleration [m/s^2]."""

SLOW_DISTANCE = 0.05
"""Distance from this pose beyond which the speed has no limit [m]."""

EMPTY_ACCELERATION = 10.0
"""Largest acceleration of an empty hand along each axis of the world [m/s^2]."""

HELD_ACCELERATION = 6.0
"""The same of a hand that holds an object at its center [m/s^2]."""

HALVING_MOMENT = 0.1
"""Moment of an object's weight about the axis through the pads that halves this acceleration [N m]."""

GRAVITY = 9.81
"""[m/s^2]"""


def near_speed(distance: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the largest speed of a hand at some distances [m] from its pose at a switch [m/s]; infinite far away."""
    beyond = np.maximum(distance - NEAR_DISTANCE, 0.0)
    speed = np.sqrt(NEAR_SPEED**2 + 2 * NEAR_ACCELERATION * beyond)
    return np.where(distance > SLOW_DISTANCE, np.inf, speed)


def hand_accelerations(
    scene: Scene,
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    phase: int,
) -> Float[np.ndarray, " arms"]:
    """Return the largest acceleration of each hand in a phase [m/s^2]; infinite where there is no limit.

    Args:
        scene: Scene of the path.
        problem: NLP of the path.
        m: Mode parameters [m or rad].
        phase: Number of the phase; that of the retreat is the number of actions.
    """
    leaving, coming = _switching_arms(problem, phase)
    limits = np.where(leaving | coming, EMPTY_ACCELERATION, np.inf)
    for item, body in enumerate(scene.objects):
        if int(problem.mode_kind[phase, item]) != ModeKind.HELD:
            continue

        # A grasp centers the object between the pads, so its offset from the gripper center is the lever of its weight.
        action = int(problem.mode_action[phase, item])
        yaw = float(problem.closing_yaw[action])
        _, offset = held.pose_on_host(m[action], yaw, np.eye(3)[None], np.zeros((1, 3)))
        moment = body.mass * GRAVITY * float(np.linalg.norm(offset))
        arm = int(problem.mode_parent[phase, item])
        limits[arm] = HELD_ACCELERATION / (1 + moment / HALVING_MOMENT)
    return limits


def shortest_times(
    problem: Problem, hands: Float[np.ndarray, "points arms 3"], phase: int
) -> Float[np.ndarray, " points-1"]:
    """Return the shortest time from each point of a phase to the next one [s]; 0 where no hand has to be slow.

    Args:
        problem: NLP of the path.
        hands: Gripper centers along the phase [m].
        phase: Number of the phase; that of the retreat is the number of actions.
    """
    travel = np.linalg.norm(np.diff(hands, axis=0), axis=2)
    middle = (hands[1:] + hands[:-1]) / 2
    leaving, coming = _switching_arms(problem, phase)
    times = np.zeros(len(travel))
    for at_switch, arms in ((hands[0], leaving), (hands[-1], coming)):
        distance = np.linalg.norm(middle - at_switch, axis=2)
        slow = np.where(arms, travel / near_speed(distance), 0.0)
        times = np.maximum(times, slow.max(axis=1))
    return times


def hand_positions(
    scene: Scene, points: Float[np.ndarray, "points joints"]
) -> Float[np.ndarray, "points arms 3"]:
    """Return the gripper centers of all arms at some joint angles [m].

    Args:
        scene: Scene of the path.
        points: Joint angles of all arms [rad].
    """
    layout = qpos_layout(scene)
    qpos = np.tile(home_qpos(scene), (len(points), 1))
    qpos[:, layout.arm_joints.reshape(-1)] = points
    return gripper_frames(scene, qpos)[0]


def _switching_arms(problem: Problem, phase: int) -> tuple[np.ndarray, np.ndarray]:
    """Return whether each arm takes part in the switch before a phase, and in the one after it."""
    arms = np.asarray(problem.arm_at_rest) > 0
    none = np.zeros(arms.shape[1], bool)
    leaving = arms[phase - 1] if phase > 0 else none
    coming = arms[phase] if phase < len(arms) else none
    return leaving, coming
