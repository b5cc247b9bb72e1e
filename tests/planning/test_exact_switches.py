"""Newton steps of joint angles within bounds, against SciPy, and hands of the Panda that are nearly in place."""

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from dvr_jax.planning.exact_switches import _Hand, _nearest_posture, _step_within
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.sampling import scene_of_seed

Floats = NDArray[np.float64]


def _shortest_step(jacobian: Floats, error: Floats, least: Floats, largest: Floats) -> Floats:
    """Return the shortest step within bounds that removes an error, by SciPy's sequential quadratic programming."""
    found = minimize(
        lambda step: step @ step,
        np.zeros(len(least)),
        jac=lambda step: 2 * step,
        bounds=list(zip(least, largest, strict=True)),
        constraints={
            "type": "eq",
            "fun": lambda step: jacobian @ step - error,
            "jac": lambda step: jacobian,
        },
        options={"ftol": 1e-14},
    )
    assert found.success
    return np.asarray(found.x)


@pytest.mark.parametrize("seed", range(6))
def test_the_step_is_the_shortest_one_if_the_bounds_are_wide(seed: int) -> None:
    generator = np.random.default_rng(seed)
    jacobian = generator.normal(size=(6, 7))
    error = 0.01 * generator.normal(size=6)
    wide = np.full(7, 10.0)
    step = _step_within(jacobian, error, -wide, wide)
    np.testing.assert_allclose(step, _shortest_step(jacobian, error, -wide, wide), atol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_other_joints_make_up_for_one_at_its_limit(seed: int) -> None:
    generator = np.random.default_rng(seed)
    jacobian = generator.normal(size=(6, 7))
    error = 0.01 * generator.normal(size=6)
    largest = np.full(7, 10.0)
    unbounded = _step_within(jacobian, error, -largest, largest)
    joint = int(np.argmax(unbounded))
    largest[joint] = 0.5 * unbounded[joint]

    step = _step_within(jacobian, error, np.full(7, -10.0), largest)
    assert step[joint] == pytest.approx(largest[joint])
    np.testing.assert_allclose(jacobian @ step, error, atol=1e-10)


def _hand() -> _Hand:
    """Return the first hand of a scene."""
    scene = scene_of_seed(7, 0, 2)
    model = build_model(scene)
    columns = qpos_layout(scene).arm_joints[0]
    velocities = np.array(
        [model.jnt_dofadr[np.flatnonzero(model.jnt_qposadr == column)[0]] for column in columns]
    )
    site = model.site(f"{scene.workcell.arm_names[0]}/gripper").id
    return _Hand(model, mujoco.MjData(model), site, columns, velocities)


def _pose(hand: _Hand, angles: Floats) -> tuple[Rotation, Floats]:
    """Return the pose of the hand at some joint angles."""
    hand.data.qpos[hand.columns] = angles
    mujoco.mj_kinematics(hand.model, hand.data)
    matrix = hand.data.site_xmat[hand.site].reshape(3, 3)
    return Rotation.from_matrix(matrix), hand.data.site_xpos[hand.site].copy()


def test_a_hand_that_is_a_millimeter_away_comes_to_its_pose_within_the_limits() -> None:
    hand = _hand()
    low, high = scene_of_seed(7, 0, 2).workcell.robot.joint_limits
    angles = np.array([0.2, 0.3, -0.9, -1.8, 0.8, 2.0, 0.5])
    # The second joint is at its limit, and alone it would go beyond.
    high = high.copy()
    high[1] = angles[1]
    rotation, position = _pose(hand, angles)
    wanted = position + np.array([1e-3, -0.5e-3, -1e-3])

    hand.data.qpos[hand.columns] = angles
    found = _nearest_posture(hand, rotation, wanted, low, high)
    assert (found >= low).all()
    assert (found <= high).all()
    reached, place = _pose(hand, found)
    np.testing.assert_allclose(place, wanted, atol=1e-7)
    assert (reached * rotation.inv()).magnitude() < 1e-7


def test_a_stretched_arm_does_not_leave_the_posture_that_is_nearest() -> None:
    hand = _hand()
    robot = scene_of_seed(7, 0, 2).workcell.robot
    low, high = robot.joint_limits
    angles = np.array([0.0, 0.6, 0.0, high[3], 0.0, 1.5, 0.7])
    rotation, position = _pose(hand, angles)
    base = hand.model.body("left/link1").id
    outward = position - hand.data.xpos[base]
    wanted = position + 3e-3 * outward / np.linalg.norm(outward)

    hand.data.qpos[hand.columns] = angles
    found = _nearest_posture(hand, rotation, wanted, low, high)
    _, place = _pose(hand, found)
    assert np.linalg.norm(place - wanted) <= np.linalg.norm(position - wanted)
