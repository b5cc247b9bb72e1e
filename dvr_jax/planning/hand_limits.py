"""Limits of the motion of hands, which keep them from pushing objects and objects from slipping out of them.

Servos lag behind where a motion is fast or accelerates much, and a hand that comes to an object passes it at a distance
of millimeters. A gripper holds by friction, so an object that is accelerated too much turns or slips between its pads.
The values were found by trial: ``python -m dvr_jax.bench execute`` measures how many executed plans succeed with them.

- **Speed.** A hand that takes or releases an object at a switch moves slowly near its pose there (`near_speed`).
- **Lag.** A servo of the stiffness k that moves the inertia M with the acceleration a lags by about ``M a / k``, and
  catches up with a time constant of 0.1 s. The lag must be less than the room between the fingers and the sides of the
  object that they pass. Where there is little room, the acceleration near the switch is therefore proportional to it
  (`near_acceleration`), both along the path of the hand and, in its curves, across it.
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

USUAL_ROOM = 0.005
"""Least room between each finger and the object at which this deceleration is used; less room lowers it [m]."""

LEAST_NEAR_ACCELERATION = 0.5
"""Least deceleration near a switch, whatever the room [m/s^2]."""

SLOW_DISTANCE = 0.1
"""Distance from this pose beyond which the speed has no limit [m]."""

EMPTY_ACCELERATION = 10.0
"""Largest acceleration of an empty hand along each axis of the world [m/s^2]."""

HELD_ACCELERATION = 6.0
"""The same of a hand that holds an object at its center [m/s^2]."""

HALVING_MOMENT = 0.1
"""Moment of an object's weight about the axis through the pads that halves this acceleration [N m]."""

LEAST_CURVATURE = 1e-3
"""Curvature below which a path counts as straight [1/m]."""

LEAST_STEP = 1e-6
"""A hand that moves by less than this between two points stays [m]."""

GRAVITY = 9.81
"""[m/s^2]"""


def near_speed(
    distance: Float[np.ndarray, "..."],
    acceleration: float | Float[np.ndarray, "..."] = NEAR_ACCELERATION,
) -> Float[np.ndarray, "..."]:
    """Return the largest speed of a hand near its pose at a switch [m/s]; infinite far away.

    Args:
        distance: Distance from this pose [m].
        acceleration: Deceleration at which the slow part is reached [m/s^2].
    """
    beyond = np.maximum(distance - NEAR_DISTANCE, 0.0)
    speed = np.sqrt(NEAR_SPEED**2 + 2 * acceleration * beyond)
    return np.where(distance > SLOW_DISTANCE, np.inf, speed)


def near_acceleration(room: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the largest acceleration of a hand near a switch [m/s^2].

    Args:
        room: Room between each finger and the object when the fingers are open [m].
    """
    return np.clip(
        NEAR_ACCELERATION * room / USUAL_ROOM, LEAST_NEAR_ACCELERATION, NEAR_ACCELERATION
    )


def _rooms(scene: Scene, problem: Problem, switch: int) -> Float[np.ndarray, " arms"]:
    """Return the room between each finger and the object that its hand takes or releases at a switch [m].

    The fingers move by this room. If they do not move at the switch, there is no object between them.

    Args:
        scene: Scene of the path.
        problem: NLP of the path.
        switch: Number of the switch.
    """
    opening = np.asarray(problem.finger_opening)
    room = np.abs(opening[switch + 1] - opening[switch])
    return np.where(room > 0, room, scene.workcell.robot.finger_travel)


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
    scene: Scene, problem: Problem, hands: Float[np.ndarray, "points arms 3"], phase: int
) -> Float[np.ndarray, " points-1"]:
    """Return the shortest time from each point of a phase to the next one [s]; 0 where no hand has to be slow.

    Args:
        scene: Scene of the path.
        problem: NLP of the path.
        hands: Gripper centers along the phase [m].
        phase: Number of the phase; that of the retreat is the number of actions.
    """
    travel = np.linalg.norm(np.diff(hands, axis=0), axis=2)
    middle = (hands[1:] + hands[:-1]) / 2
    curvature = _curvature(hands)
    leaving, coming = _switching_arms(problem, phase)
    times = np.zeros(len(travel))
    for switch, at_switch, arms in (
        (phase - 1, hands[0], leaving),
        (phase, hands[-1], coming),
    ):
        if not arms.any():
            continue
        distance = np.linalg.norm(middle - at_switch, axis=2)
        acceleration = near_acceleration(_rooms(scene, problem, switch))
        speed = near_speed(distance, acceleration)

        # In a curve, the acceleration across the path is the squared speed times the curvature.
        is_narrow = (acceleration < NEAR_ACCELERATION) & (distance <= SLOW_DISTANCE)
        in_curve = np.sqrt(acceleration / np.maximum(curvature, LEAST_CURVATURE))
        speed = np.where(is_narrow, np.minimum(speed, in_curve), speed)

        slow = np.where(arms, travel / speed, 0.0)
        times = np.maximum(times, slow.max(axis=1))
    return times


def _curvature(
    hands: Float[np.ndarray, "points arms 3"],
) -> Float[np.ndarray, "points-1 arms"]:
    """Return the curvature of the paths of hands between each point and the next one [1/m]; 0 where a hand stays."""
    if len(hands) < 3:
        return np.zeros((len(hands) - 1, hands.shape[1]))

    # The curvature of a curve x(u) is |x' x x''| / |x'|^3, for any parameter u.
    first = np.gradient(hands, axis=0)
    second = np.gradient(first, axis=0)
    speed = np.linalg.norm(first, axis=2)
    across = np.linalg.norm(np.cross(first, second), axis=2)
    curvature = np.where(speed > LEAST_STEP, across / np.maximum(speed, LEAST_STEP) ** 3, 0.0)
    return np.maximum(curvature[1:], curvature[:-1])


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
