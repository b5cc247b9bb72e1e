"""Closed-form inverse kinematics: against MuJoCo's forward kinematics, and every posture found again."""

from collections.abc import Callable

import jax
import mujoco
import numpy as np
import pytest
from arm_states import Floats, Simulated, sample_postures

from dvr_jax.runtime.compilation import CPU_OPTIONS
from dvr_jax.workcell.model import workcell_model
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.panda.inverse_kinematics import BRANCHES, arm_angles
from dvr_jax.workcell.workcell import WORKCELLS, Workcell, base_positions, base_rotations

JOINT_LOWER, JOINT_UPPER = PANDA.joint_limits
POSTURES = 1000

STRETCHED = -(np.arctan(0.0825 / 0.316) + np.arctan(0.0825 / 0.384))
"""The q4 at which shoulder, elbow and wrist centre lie on one line, -0.467 rad. Two values of q4, one on either side
of it, give the same distance from shoulder to wrist; the closed form takes the more bent one."""

Solve = Callable[..., tuple[Floats, Floats]]


@pytest.fixture(scope="module")
def solve() -> Solve:
    compiled = jax.jit(arm_angles, compiler_options=CPU_OPTIONS)

    def call(reached: "Reached", R: Floats, p: Floats, q7: Floats) -> tuple[Floats, Floats]:
        """For world poses (n, ...) of the grippers of the first n arms."""
        base_R = base_rotations(reached.workcell)[reached.arm[: len(p)]]
        base_p = base_positions(reached.workcell)[reached.arm[: len(p)]]
        local_R = base_R.transpose(0, 2, 1) @ R
        local_p = np.einsum("nji,nj->ni", base_R, p - base_p)
        # Columns first.
        model = workcell_model(reached.workcell)
        q, failure = compiled(model, local_R.transpose(2, 1, 0), local_p.T, q7[None])
        assert np.isfinite(q).all()
        assert np.isfinite(failure).all() and (np.asarray(failure) >= 0).all()
        return np.asarray(q), np.asarray(failure) == 0

    return call


class Reached:
    """Random postures of all arms in turn, with the gripper poses that MuJoCo gives them."""

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.simulated = Simulated(workcell)
        every, openings = sample_postures(POSTURES, seed=1, workcell=workcell)
        self.arm = np.arange(POSTURES) % workcell.number_of_arms
        self.q = every[np.arange(POSTURES), self.arm]
        self.R, self.p = np.zeros((POSTURES, 3, 3)), np.zeros((POSTURES, 3))
        for n, data in enumerate(self.simulated.states(every, openings)):
            self.R[n], self.p[n] = self.gripper(data, self.arm[n])

    def gripper(self, data: mujoco.MjData, arm: int) -> tuple[Floats, Floats]:
        site = data.site(f"{self.workcell.arm_names[arm]}/gripper")
        return site.xmat.reshape(3, 3).copy(), site.xpos.copy()


@pytest.fixture(scope="module", params=["facing", "side-by-side", "single"])
def reached(request: pytest.FixtureRequest) -> Reached:
    return Reached(WORKCELLS[request.param])


def test_the_robot_names_its_inverse_kinematics(reached: Reached) -> None:
    """What the rest of the package calls is this closed form."""
    kinematics = workcell_model(reached.workcell).structure.inverse_kinematics
    assert kinematics is PANDA.inverse_kinematics
    assert (kinematics.branches, kinematics.free_joints) == (BRANCHES, (6,))
    arguments = (
        workcell_model(reached.workcell),
        np.eye(3)[:, :, None],
        np.array([[0.4], [0.1], [0.5]]),
        np.zeros((1, 1)),
    )
    for ours, theirs in zip(kinematics.solve(*arguments), arm_angles(*arguments), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_valid_branches_reach_their_pose_within_the_limits(solve: Solve, reached: Reached) -> None:
    q, valid = solve(reached, reached.R, reached.p, reached.q[:, 6])
    assert q.shape == (7, BRANCHES, POSTURES)
    assert valid.sum() > POSTURES
    lanes = np.argwhere(valid)
    angles = np.stack([q[:, branch, n] for branch, n in lanes])
    assert (angles >= np.array(JOINT_LOWER)).all()
    assert (angles <= np.array(JOINT_UPPER)).all()
    arms = reached.workcell.number_of_arms
    every = np.repeat(angles[:, None], arms, axis=1)
    for (_, n), data in zip(
        lanes, reached.simulated.states(every, np.zeros((len(lanes), arms))), strict=True
    ):
        R, p = reached.gripper(data, reached.arm[n])
        np.testing.assert_allclose(p, reached.p[n], rtol=0, atol=1e-9)
        np.testing.assert_allclose(R, reached.R[n], rtol=0, atol=1e-9)


def found_again(solve: Solve, reached: Reached) -> Floats:
    q, valid = solve(reached, reached.R, reached.p, reached.q[:, 6])
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
    q, valid = solve(reached, reached.R, reached.p, reached.q[:, 6])
    for a in range(BRANCHES):
        for b in range(a):
            both = valid[a] & valid[b]
            assert (np.abs(q[:, a] - q[:, b]).max(0)[both] > 1e-6).all()


def test_the_last_joint_is_free(solve: Solve, reached: Reached) -> None:
    """Other values of q7 give other postures for the same pose; the angle asked for comes back."""
    q7 = np.clip(reached.q[:, 6] + 0.1, JOINT_LOWER[6], JOINT_UPPER[6])
    q, valid = solve(reached, reached.R, reached.p, q7)
    np.testing.assert_array_equal(q[6], np.broadcast_to(q7, q[6].shape))
    assert valid.any(0).mean() > 0.5


def test_unreachable_poses_are_invalid_and_finite(solve: Solve, reached: Reached) -> None:
    """Too far, too near (the gripper inside the own base), exactly at singular points."""
    n = 60
    shoulder = base_positions(reached.workcell)[reached.arm[:n]] + [0, 0, 0.333]
    p = reached.p[:n].copy()
    p[:20] += [0, 3.0, 0]
    p[20:40] = shoulder[20:40]
    p[40:] = [0, 0, 50]
    q, valid = solve(reached, reached.R[:n], p, reached.q[:n, 6])
    assert np.isfinite(q).all()
    assert not valid[:, :20].any()
    assert not valid[:, 40:].any()
    down = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (n, 3, 3))
    for height in (0, 0.316 + 0.384, 1.2 - 0.333, -0.333):
        q, valid = solve(
            reached, down, shoulder + np.array([0, 0, height]), np.linspace(-2.8, 2.8, n)
        )
        assert np.isfinite(q).all()
    q, valid = solve(reached, down, np.zeros((n, 3)), np.linspace(-2.8, 2.8, n))
    assert np.isfinite(q).all()


def test_limits_are_kept_strictly(solve: Solve, reached: Reached) -> None:
    """q7 beyond its range is never valid."""
    q7 = np.full(POSTURES, JOINT_UPPER[6] + 1e-6)
    _, valid = solve(reached, reached.R, reached.p, q7)
    assert not valid.any()
