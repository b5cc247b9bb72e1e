"""Jerks and torques in the check: clean motions pass, and both limits from both sides."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from puppet import Case, layout_of
from wrong_motions import with_object

from dvr_jax.checker import CheckReport, Finding, check_motion
from dvr_jax.motion import Motion
from dvr_jax.scene.mjcf import build_model

Floats = NDArray[np.float64]

LAYOUT = layout_of(2)
JERK = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]
"""Limits of the Panda's joints [rad/s^3]."""

TORQUE = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
"""Limits of the Panda's joints [N m]."""


def check_all(case: Case) -> CheckReport:
    return check_motion(case.scene, case.actions, case.motion, dynamics=True)


def findings_of(case: Case, kind: str) -> dict[tuple[str, ...], Finding]:
    return {finding.names: finding for finding in check_all(case).findings if finding.kind == kind}


@pytest.mark.parametrize("name", ["carry", "carry_cylinder", "handover"])
def test_a_clean_motion_passes(name: str, request: pytest.FixtureRequest) -> None:
    case = request.getfixturevalue(name)
    assert check_all(case) == check_motion(case.scene, case.actions, case.motion)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize(
    ("moved", "largest", "sample"),
    [(slice(30, 31), 3, 30), (slice(1, None), 2, 1), (slice(-1, None), 2, 59)],
    ids=["middle", "start", "end"],
)
def test_the_limit_of_the_jerk(
    carry: Case, joint: int, moved: slice, largest: int, sample: int
) -> None:
    """An arm that rests, but for one joint in some samples at 1 kHz; `largest` is that of the third differences."""
    step = 0.001
    number = 60
    for factor in (0.99, 1.01):
        qpos = np.tile(carry.motion.qpos[0], (number, 1))
        qpos[moved, LAYOUT.arm_joints[1, joint]] += factor * JERK[joint] * step**3 / largest
        motion = Motion(np.arange(number) * step, qpos, np.array([20, 40]))
        found = findings_of(replace(carry, motion=motion), "joint jerk")
        if factor < 1:
            assert found == {}
            continue

        (finding,) = found.values()
        assert finding.names == (f"right/joint{joint + 1}",)
        assert finding.value == pytest.approx(factor * JERK[joint], rel=1e-6)
        assert finding.time == pytest.approx(sample * step)
        assert f"the acceleration of right/joint{joint + 1} changes by" in str(finding)


def held_at_rest(case: Case) -> Case:
    """The left arm rests with the box in its hand, from the second sample to the end."""
    qpos = np.tile(case.motion.qpos[int(case.motion.switch.mean())], (6, 1))
    motion = Motion(0.02 * np.arange(6), qpos, np.array([1]))
    return replace(case, actions=case.actions[:1], motion=motion)


def torques_of_weights(case: Case) -> tuple[Floats, Floats]:
    """Torques (7) of the left arm at rest for its own weight, and for that of each kilogram of the box [N m]."""
    model = build_model(case.scene)
    data = mujoco.MjData(model)
    data.qpos[:] = case.motion.qpos[-1]
    mujoco.mj_forward(model, data)
    dofs = [model.joint(f"left/joint{joint}").dofadr[0] for joint in range(1, 8)]
    jacobian = np.zeros((3, model.nv))
    box = data.body("object/yellow").xpos
    mujoco.mj_jac(model, data, jacobian, None, box, model.body("left/hand").id)
    return data.qfrc_bias[dofs].copy(), -jacobian.T[dofs] @ model.opt.gravity


def test_the_limit_of_the_torque(carry: Case) -> None:
    """The box is as heavy as the arm can hold, a hundredth lighter and heavier."""
    case = held_at_rest(carry)
    own, of_kilogram = torques_of_weights(case)
    masses = (TORQUE - np.sign(of_kilogram) * own) / np.maximum(np.abs(of_kilogram), 1e-9)
    weakest = int(masses.argmin())
    box = case.scene.objects[0]
    density = masses.min() * box.density / box.mass

    assert findings_of(with_object(0, density=0.99 * density)(case), "joint torque") == {}
    (finding,) = findings_of(with_object(0, density=1.01 * density)(case), "joint torque").values()
    assert finding.names == (f"left/joint{weakest + 1}",)
    expected = abs(own + 1.01 * masses.min() * of_kilogram)[weakest]
    assert finding.value == pytest.approx(expected, rel=1e-6)
    assert str(finding).endswith(f"(limit {TORQUE[weakest]:.3g} N m)")


def test_what_is_not_held_weighs_nothing(carry: Case) -> None:
    heavy = with_object(1, density=1e6)(held_at_rest(carry))
    assert findings_of(heavy, "joint torque") == {}


def test_a_fast_motion_needs_more_torque(carry: Case) -> None:
    fast = Motion(carry.motion.time / 8, carry.motion.qpos, carry.motion.switch)
    found = findings_of(replace(carry, motion=fast), "joint torque")
    assert found and {names[0].split("/")[0] for names in found} == {"left"}
