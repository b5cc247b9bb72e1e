"""Closed-form inverse kinematics: against MuJoCo's forward kinematics, and every posture found again."""

from collections.abc import Callable

import jax
import mujoco
import numpy as np
import pytest
from arm_states import Floats, sample_postures, set_postures

from dvr_jax.scene.files import Goal, Region, SceneObject, make_scene
from dvr_jax.scene.mjcf import build_model
from dvr_jax.workcell.constants import ARM_NAMES, JOINT_LOWER, JOINT_UPPER
from dvr_jax.workcell.panda.inverse_kinematics import BRANCHES, arm_angles

SCENE = make_scene(
    [SceneObject("box", "box", (0.05, 0.1, 0.1), (0.0, 0.3), 0.3)], Goal("box", Region((0, 0), 0, (0.2, 0.2)))
)
POSTURES = 1000

STRETCHED = -(np.arctan(0.0825 / 0.316) + np.arctan(0.0825 / 0.384))
"""The q4 at which shoulder, elbow and wrist centre lie on one line, -0.467 rad. Two values of q4, one on either side
of it, give the same distance from shoulder to wrist; the closed form takes the more bent one."""

Solve = Callable[..., tuple[Floats, Floats]]


@pytest.fixture(scope="module")
def solve() -> Solve:
    compiled = jax.jit(arm_angles)

    def call(arm: Floats, R: Floats, p: Floats, q7: Floats) -> tuple[Floats, Floats]:
        q, failure = compiled(arm, R.transpose(2, 1, 0), p.T, q7)
        assert np.isfinite(q).all()
        return np.asarray(q), np.asarray(failure) == 0

    return call


class Reached:
    """Random postures, alternately of the left and the right arm, with the gripper poses that MuJoCo gives them."""

    def __init__(self) -> None:
        self.model = build_model(SCENE)
        both, openings = sample_postures(POSTURES, seed=1)
        self.arm = np.arange(POSTURES) % 2
        self.q = both[np.arange(POSTURES), self.arm]
        self.R, self.p = np.zeros((POSTURES, 3, 3)), np.zeros((POSTURES, 3))
        for n, data in enumerate(set_postures(self.model, both, openings)):
            self.R[n], self.p[n] = gripper(data, self.arm[n])


def gripper(data: mujoco.MjData, arm: int) -> tuple[Floats, Floats]:
    site = data.site(f"{ARM_NAMES[arm]}/gripper")
    return site.xmat.reshape(3, 3).copy(), site.xpos.copy()


@pytest.fixture(scope="module")
def reached() -> Reached:
    return Reached()


def test_valid_branches_reach_their_pose_within_the_limits(solve: Solve, reached: Reached) -> None:
    q, valid = solve(reached.arm, reached.R, reached.p, reached.q[:, 6])
    assert q.shape == (7, BRANCHES, POSTURES)
    assert valid.sum() > POSTURES
    lanes = np.argwhere(valid)
    angles = np.stack([q[:, branch, n] for branch, n in lanes])
    assert (angles >= np.array(JOINT_LOWER)).all()
    assert (angles <= np.array(JOINT_UPPER)).all()
    both = np.repeat(angles[:, None], 2, axis=1)
    for (_, n), data in zip(lanes, set_postures(reached.model, both, np.zeros((len(lanes), 2))), strict=True):
        R, p = gripper(data, reached.arm[n])
        np.testing.assert_allclose(p, reached.p[n], rtol=0, atol=1e-9)
        np.testing.assert_allclose(R, reached.R[n], rtol=0, atol=1e-9)


def found_again(solve: Solve, reached: Reached) -> Floats:
    q, valid = solve(reached.arm, reached.R, reached.p, reached.q[:, 6])
    same = np.abs(q - reached.q.T[:, None]).max(0) < 1e-6
    return (same & valid).any(0)


def test_every_posture_with_a_bent_elbow_is_found_again(solve: Solve, reached: Reached) -> None:
    found = found_again(solve, reached)
    bent = reached.q[:, 3] < STRETCHED - 3e-3
    assert bent.sum() > 0.8 * POSTURES
    assert found[bent].all(), reached.q[bent & ~found]


def test_only_the_nearly_stretched_elbow_is_missed(solve: Solve, reached: Reached) -> None:
    found = found_again(solve, reached)
    stretched = reached.q[:, 3] > STRETCHED + 5e-4
    assert stretched.sum() > 50
    assert not found[stretched].any()
    assert (reached.q[~found, 3] > STRETCHED).all()


def test_branches_are_distinct(solve: Solve, reached: Reached) -> None:
    q, valid = solve(reached.arm, reached.R, reached.p, reached.q[:, 6])
    for a in range(BRANCHES):
        for b in range(a):
            both = valid[a] & valid[b]
            assert (np.abs(q[:, a] - q[:, b]).max(0)[both] > 1e-6).all()


def test_the_last_joint_is_free(solve: Solve, reached: Reached) -> None:
    """Other values of q7 give other postures for the same pose; the angle asked for comes back."""
    q7 = np.clip(reached.q[:, 6] + 0.1, JOINT_LOWER[6], JOINT_UPPER[6])
    q, valid = solve(reached.arm, reached.R, reached.p, q7)
    np.testing.assert_array_equal(q[6], np.broadcast_to(q7, q[6].shape))
    assert valid.any(0).mean() > 0.5


def test_unreachable_poses_are_invalid_and_finite(solve: Solve, reached: Reached) -> None:
    """Too far, too near (the gripper inside the own base), exactly at singular points."""
    n = 60
    p = reached.p[:n].copy()
    p[:20] += [0, 3.0, 0]
    p[20:40] = np.where(reached.arm[20:40, None] == 0, [-0.75, 0, 0.333], [0.75, 0, 0.333])
    p[40:] = [0, 0, 50]
    q, valid = solve(reached.arm[:n], reached.R[:n], p, reached.q[:n, 6])
    assert np.isfinite(q).all()
    assert not valid[:, :20].any()
    assert not valid[:, 40:].any()
    aligned = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (n, 3, 3))
    for point in ([-0.75, 0, 0.333], [-0.75, 0, 0.333 + 0.316 + 0.384], [-0.75, 0, 1.2], [0, 0, 0]):
        q, valid = solve(np.zeros(n, int), aligned, np.tile(np.array(point), (n, 1)), np.linspace(-2.8, 2.8, n))
        assert np.isfinite(q).all()


def test_limits_are_kept_strictly(solve: Solve, reached: Reached) -> None:
    """q7 beyond its range is never valid."""
    q7 = np.full(POSTURES, JOINT_UPPER[6] + 1e-6)
    _, valid = solve(reached.arm, reached.R, reached.p, q7)
    assert not valid.any()
