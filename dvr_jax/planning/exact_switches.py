"""Postures at mode switches in which an object has exactly the same pose before and after the switch.

The NLP asks for equal poses up to a tolerance of a millimeter, and a motion in which an object jumped by that much
would press it into the table or into the fingers. The arm that acts at a switch is therefore moved to the hand's pose
that both modes of the object demand. With the position p and rotation R of the hand, those that are demanded
(p*, R*), and the Jacobian J of the hand, Newton's method takes the shortest steps

    dq = J^+ (p* - p, log(R* R^T)),

in which joints that would leave their range stop at its end, and the others make up for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from dvr_jax.modes import held
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem
from dvr_jax.planning.carried_objects import gripper_frames, object_pose
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene

NEWTON_STEPS = 3
"""Number of Newton steps; each one squares an error that is a thousandth at first."""


def exact_switches(
    scene: Scene,
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    m: Float[np.ndarray, "phases 4"],
) -> Float[np.ndarray, "slices joints"]:
    """Return a path whose arms are exactly where objects have one pose at each mode switch.

    Joints stay within their limits, so that a small part of a jump remains where an arm is at a limit. An arm that is
    stretched out may be unable to come nearer; then it stays where the path has it.

    Args:
        scene: Scene of the path.
        problem: NLP of the path's sequence, without batch axes.
        q: Joint angles in the slices [rad].
        m: Mode parameters of each action [m or rad].
    """
    K = len(m)
    S = len(q) // K
    layout = qpos_layout(scene)
    low, high = scene.workcell.robot.joint_limits
    exact = np.array(q, float)
    model = build_model(scene)
    data = mujoco.MjData(model)

    for k in range(K):
        arm = int(problem.acting_arm[k])
        slice_index = (k + 1) * S - 1
        columns = layout.arm_joints[arm]
        qpos = np.zeros((1, layout.size))
        qpos[0, layout.arm_joints.reshape(-1)] = exact[slice_index]
        rotation, position = _demanded_pose(scene, problem, m, k, qpos)

        data.qpos[:] = qpos[0]
        hand = _Hand(
            model,
            data,
            site=model.site(f"{scene.workcell.arm_names[arm]}/gripper").id,
            columns=columns,
            velocities=_velocity_columns(model, columns),
        )
        data.qpos[columns] = _nearest_posture(hand, rotation, position, low, high)
        exact[slice_index] = data.qpos[layout.arm_joints.reshape(-1)]
    return exact


@dataclass(frozen=True)
class _Hand:
    """The hand of one arm in a model, with a state of the whole scene."""

    model: mujoco.MjModel
    """Model of the scene."""

    data: mujoco.MjData
    """State of the scene; the joints of the arm are changed in it."""

    site: int
    """Number of the site that is the hand."""

    columns: Int[np.ndarray, " joints"]
    """Where the angles of the arm's joints are in the state."""

    velocities: Int[np.ndarray, " joints"]
    """Where their velocities are among MuJoCo's velocities."""

    def error(
        self, rotation: Rotation, position: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, " 6"]:
        """Return the translation [m] and the rotation vector [rad] that bring the hand to a pose.

        Args:
            rotation: Rotation of the pose.
            position: Its position [m].
        """
        mujoco.mj_kinematics(self.model, self.data)
        present = Rotation.from_matrix(self.data.site_xmat[self.site].reshape(3, 3))
        turn = (rotation * present.inv()).as_rotvec()
        return np.concatenate([position - self.data.site_xpos[self.site], turn])

    def jacobian(self) -> Float[np.ndarray, "6 joints"]:
        """Return the derivatives of the hand's translation and rotation by the angles of the arm's joints."""
        mujoco.mj_comPos(self.model, self.data)
        by_position = np.zeros((3, self.model.nv))
        by_rotation = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, by_position, by_rotation, self.site)
        return np.concatenate([by_position, by_rotation])[:, self.velocities]


def _nearest_posture(
    hand: _Hand,
    rotation: Rotation,
    position: Float[np.ndarray, " 3"],
    low: Float[np.ndarray, " joints"],
    high: Float[np.ndarray, " joints"],
) -> Float[np.ndarray, " joints"]:
    """Return the joint angles on the way of Newton's method at which a hand is nearest to a pose [rad].

    Args:
        hand: The hand.
        rotation: Rotation of the pose.
        position: Its position [m].
        low: Least joint angles [rad].
        high: Largest joint angles [rad].
    """
    angles = np.clip(hand.data.qpos[hand.columns], low, high)
    postures = []
    distances = []
    for _ in range(NEWTON_STEPS + 1):
        hand.data.qpos[hand.columns] = angles
        error = hand.error(rotation, position)
        postures.append(angles)
        distances.append(float(np.linalg.norm(error)))
        angles = angles + _step_within(hand.jacobian(), error, low - angles, high - angles)

    # Where the arm is stretched out, the steps are long and lead nowhere.
    return postures[int(np.argmin(distances))]


def _demanded_pose(
    scene: Scene,
    problem: Problem,
    m: Float[np.ndarray, "phases 4"],
    k: int,
    qpos: Float[np.ndarray, "1 states"],
) -> tuple[Rotation, Float[np.ndarray, " 3"]]:
    """Return rotation and position of the acting hand that the modes before and after a switch demand together.

    In one of the two modes the acting hand holds the object. The other one gives the pose of the object.
    """
    item = int(problem.switched_object[k])
    arm = int(problem.acting_arm[k])
    is_grasp = int(problem.mode_kind[k + 1, item]) == ModeKind.HELD
    holding, other = (k + 1, k) if is_grasp else (k, k + 1)
    assert int(problem.mode_parent[holding, item]) == arm

    hand_position, hand_rotation = gripper_frames(scene, qpos)
    found = object_pose(problem, m, other, item, hand_position, hand_rotation)
    p_world_object = np.reshape(found[0], 3)
    R_world_object = found[1].as_matrix().reshape(3, 3)

    action = int(problem.mode_action[holding, item])
    closing_yaw = float(problem.closing_yaw[action])
    R_object_hand, p_object_hand = held.frame_on_host(m[action], closing_yaw)
    return (
        Rotation.from_matrix(R_world_object @ R_object_hand),
        p_world_object + R_world_object @ p_object_hand,
    )


def _step_within(
    jacobian: Float[np.ndarray, "6 joints"],
    error: Float[np.ndarray, " 6"],
    least: Float[np.ndarray, " joints"],
    largest: Float[np.ndarray, " joints"],
) -> Float[np.ndarray, " joints"]:
    """Return the shortest change of joint angles that removes an error to first order, within bounds [rad].

    Args:
        jacobian: Derivatives of the pose by the joint angles.
        error: What is missing to the pose [m and rad].
        least: Least change of each angle, at most 0 [rad].
        largest: Largest change of each angle, at least 0 [rad].
    """
    step = np.zeros(len(least))
    free = np.ones(len(least), bool)
    while free.any():
        rest = error - jacobian[:, ~free] @ step[~free]
        step[free] = np.linalg.pinv(jacobian[:, free]) @ rest
        leaves = free & ((step < least) | (step > largest))
        if not leaves.any():
            break

        # These joints stop at the ends of their ranges.
        step[leaves] = np.clip(step, least, largest)[leaves]
        free &= ~leaves
    return step


def _velocity_columns(
    model: mujoco.MjModel, columns: Int[np.ndarray, " joints"]
) -> Int[np.ndarray, " joints"]:
    """Return where the velocities of hinges are among MuJoCo's velocities, given where their angles are."""
    joints = [int(np.flatnonzero(model.jnt_qposadr == column)[0]) for column in columns]
    return np.asarray(model.jnt_dofadr[joints])
