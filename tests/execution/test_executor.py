"""Executed motions: what should succeed succeeds, and what goes wrong is found with its time and cause."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from other_robots import SIX_JOINTS
from puppet import Case
from scipy.interpolate import interp1d

from dvr_jax.checker.operators import CHECKS
from dvr_jax.checker.timeline import attachment_timeline
from dvr_jax.errors import MotionError, OptionError
from dvr_jax.execution import DeviationCause, ExecutionConditions, ExecutionReport, execute
from dvr_jax.execution.commands import grip_intervals, servo_commands
from dvr_jax.execution.physics_model import build_execution_model
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import COLLISION_GROUP, LOOKS_GROUP, build_model, object_body_name
from dvr_jax.scene.types import SceneObject
from dvr_jax.workcell.robot import FINGERS
from dvr_jax.workcell.workcell import Arm, Workcell

NOMINAL = ExecutionConditions()


def executed(case: Case, conditions: ExecutionConditions = NOMINAL) -> ExecutionReport:
    return execute(case.scene, case.actions, case.motion, conditions).report


@pytest.mark.parametrize("name", ["carry", "carry_cylinder", "handover"])
def test_a_sound_motion_succeeds(name: str, request: pytest.FixtureRequest) -> None:
    report = executed(request.getfixturevalue(name))
    assert report.succeeded
    assert report.deviation is None
    assert max(item.displacement for item in report.objects) < 5e-3
    assert max(item.turn for item in report.objects) < 0.05


def test_the_same_seed_gives_the_same_states(carry: Case) -> None:
    conditions = ExecutionConditions(object_noise=0.002, seed=5)
    first, second = (
        execute(carry.scene, carry.actions, carry.motion, conditions) for _ in range(2)
    )
    np.testing.assert_array_equal(first.qpos, second.qpos)
    assert first.report == second.report
    other = execute(carry.scene, carry.actions, carry.motion, replace(conditions, seed=6))
    assert np.abs(other.qpos[0] - first.qpos[0]).max() > 1e-4
    # A displacement alone is no deviation.
    assert first.report.succeeded and first.report.deviation is None


def test_friction_decides_whether_an_object_comes_along(carry: Case) -> None:
    """Two pads hold up to ``2 friction force``; the box weighs 1.2 N."""
    holding, slipping = (
        executed(carry, ExecutionConditions(friction=0.01, grip_force=force))
        for force in (70.0, 40.0)
    )
    assert holding.succeeded
    assert not slipping.succeeded
    assert slipping.deviation is not None
    assert slipping.deviation.cause in (DeviationCause.MISSED, DeviationCause.SLIPPED)
    lifts = carry.motion.time[carry.motion.switch[0]]
    assert lifts <= slipping.deviation.time < lifts + 1.0


def test_an_object_has_the_friction_and_the_weight_of_its_scene(carry: Case) -> None:
    """With the friction 0.01 the pads hold 1.4 N: the box of 1.2 N, but neither a box of 2.4 N nor a smoother one."""
    box = carry.scene.objects[0]
    slippery = replace(box, friction=0.01)
    assert executed(_with_object(carry, slippery)).succeeded
    assert not executed(_with_object(carry, replace(slippery, density=2 * box.density))).succeeded
    smoother = ExecutionConditions(friction=0.5)
    assert not executed(_with_object(carry, slippery), smoother).succeeded


def _with_object(case: Case, item: SceneObject) -> Case:
    """The case with another first object."""
    return replace(case, scene=replace(case.scene, objects=(item, *case.scene.objects[1:])))


def with_travel(case: Case, samples: slice, travel: float) -> Case:
    """The case with other travels of the left fingers in some samples."""
    qpos = case.motion.qpos.copy()
    qpos[samples, qpos_layout(case.scene).fingers[0]] = travel
    return replace(case, motion=Motion(case.motion.time, qpos, case.motion.switch))


def test_closed_fingers_push_what_they_should_grasp(carry: Case) -> None:
    report = executed(with_travel(carry, slice(None, int(carry.motion.switch[0])), 0.0))
    assert not report.succeeded
    assert report.deviation is not None
    assert report.deviation.object == "yellow"
    assert report.deviation.cause is DeviationCause.PUSHED
    assert report.deviation.touched_by[0].startswith("left/finger_")
    assert report.deviation.time < carry.motion.time[carry.motion.switch[0]]
    assert "was pushed before its grasp" in report.deviation.sentence()


def test_a_push_that_ends_in_a_grasp_is_a_push(carry: Case) -> None:
    """A finger shifts the box to the middle of the gripper, which lifts it there: off by less than a centimeter as it
    is grasped, and by more afterwards."""
    layout = qpos_layout(carry.scene)
    item = layout.objects[carry.scene.object_index("yellow")]
    qpos = carry.motion.qpos.copy()
    # The box is planned beside where the gripper closes, 2 mm from the inner side of an open finger.
    axis = np.array([np.cos(0.3), np.sin(0.3)])
    qpos[:, item[:2]] += 0.013 * axis
    shifted = replace(carry, motion=Motion(carry.motion.time, qpos, carry.motion.switch))
    done = execute(shifted.scene, shifted.actions, shifted.motion, NOMINAL)
    grasp = int(carry.motion.switch[0])
    off = np.linalg.norm(done.qpos[: len(qpos), item[:3]] - qpos[:, item[:3]], axis=1)
    assert 3e-3 < off[grasp] < 0.8e-2
    assert off[grasp:].max() > 1.05e-2
    assert done.report.deviation is not None
    assert done.report.deviation.cause is DeviationCause.PUSHED
    assert done.report.deviation.touched_by == ("left/finger_left",)
    assert done.report.deviation.time < carry.motion.time[grasp]


def test_an_opened_gripper_drops_its_object(carry: Case) -> None:
    first, last = carry.motion.switch
    middle = int(first + last) // 2
    report = executed(with_travel(carry, slice(middle, int(last)), 0.04))
    assert not report.succeeded
    assert report.deviation is not None
    assert report.deviation.cause is DeviationCause.SLIPPED
    assert report.deviation.time == pytest.approx(carry.motion.time[middle], abs=0.5)


def test_a_displaced_object_is_dropped_where_the_gripper_opens(carry: Case) -> None:
    """Its grasp is off by some millimeters, which is no cause of its fall."""
    first, last = carry.motion.switch
    middle = int(first + last) // 2
    conditions = ExecutionConditions(object_noise=0.003, seed=1)
    report = executed(with_travel(carry, slice(middle, int(last)), 0.04), conditions)
    assert report.deviation is not None
    assert report.deviation.cause is DeviationCause.SLIPPED
    assert report.deviation.time == pytest.approx(carry.motion.time[middle], abs=0.5)


def test_a_motion_of_small_or_large_steps_is_recorded_whole(carry: Case) -> None:
    for step in (0.0004, 2.0):
        time = step * np.arange(5)
        still = Motion(time, np.repeat(carry.motion.qpos[:1], 5, axis=0), np.zeros(0, int))
        done = execute(carry.scene, (), still)
        assert len(done.qpos) == len(done.time) and done.time[-1] >= time[-1] + 1.5
        assert np.abs(done.qpos - done.qpos[0]).max() < 3e-4
        assert done.report.deviation is None


def test_a_simulation_that_diverges_says_so(
    carry: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    qpos = carry.motion.qpos.copy()
    qpos[0, qpos_layout(carry.scene).objects[1, 2]] = 1e11
    report = executed(replace(carry, motion=Motion(carry.motion.time, qpos, carry.motion.switch)))
    assert not report.is_stable and not report.succeeded
    assert (report.deviation, report.failure) == (None, "the simulation diverged")
    # MuJoCo's own file of warnings.
    assert list(tmp_path.iterdir()) == []


def test_a_motion_of_another_scene_is_refused(carry: Case) -> None:
    with pytest.raises(MotionError, match="one an action"):
        execute(carry.scene, carry.actions[:1], carry.motion)
    short = Motion(carry.motion.time, carry.motion.qpos[:, :-7], carry.motion.switch)
    with pytest.raises(MotionError, match="the motion's states have"):
        execute(carry.scene, carry.actions, short)


def test_an_object_in_the_way_is_hit(carry: Case) -> None:
    layout = qpos_layout(carry.scene)
    item = carry.scene.object_index("can")
    way = (carry.motion.switch[0] + carry.motion.switch[1]) // 2
    in_the_way = carry.motion.qpos[way, layout.objects[0, :2]]
    qpos = carry.motion.qpos.copy()
    qpos[:, layout.objects[item, :2]] = in_the_way
    moved = replace(carry, motion=Motion(carry.motion.time, qpos, carry.motion.switch))
    report = executed(moved)
    assert report.deviation is not None
    assert (report.deviation.object, report.deviation.cause) == ("can", DeviationCause.COLLISION)
    assert "object/yellow" in report.deviation.touched_by


def colliding(model: mujoco.MjModel) -> dict[str, set[str]]:
    """Of each body of an arm, which of its geoms meet an object: those that are shown, its capsules, or its pad."""
    item = model.geom(object_body_name("yellow"))
    found: dict[str, set[str]] = {}
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom]).name
        if body.startswith(("object/", "fixed/")) or body in ("world", "table"):
            continue
        kinds = found.setdefault(body, set())
        meets = (model.geom_contype[geom] & item.conaffinity[0]) | (
            item.contype[0] & model.geom_conaffinity[geom]
        )
        if meets and model.geom(geom).name.endswith("_pad"):
            kinds.add("pad")
        elif meets:
            kinds.add({LOOKS_GROUP: "shown", COLLISION_GROUP: "capsule"}[model.geom_group[geom]])
    return found


def test_fingers_collide_with_what_they_show_and_all_else_with_its_capsules(carry: Case) -> None:
    found = colliding(build_execution_model(carry.scene, NOMINAL))
    fingers = {f"{arm}/{finger}" for arm in ("left", "right") for finger in FINGERS}
    links = {f"{arm}/link{number}" for arm in ("left", "right") for number in range(1, 8)}
    bodies = links | {f"{arm}/{body}" for arm in ("left", "right") for body in ("base", "hand")}
    expected = {body: {"pad", "shown"} for body in fingers} | {body: {"capsule"} for body in bodies}
    assert found == expected
    # The scene's own model, which serves kinematics, has no pads, and its fingers collide with their capsules.
    own = colliding(build_model(carry.scene))
    assert own == {body: {"capsule"} for body in fingers | bodies}


def test_fingers_that_show_nothing_collide_with_their_capsules(carry: Case) -> None:
    robot = SIX_JOINTS
    arm = Arm("arm", (0.0, -0.4), np.pi / 2, home=robot.home)
    scene = replace(carry.scene, workcell=Workcell((arm,), robot=robot))
    found = colliding(build_execution_model(scene, NOMINAL))
    assert {body: kinds for body, kinds in found.items() if "finger" in body} == {
        f"arm/{finger}": {"pad", "capsule"} for finger in FINGERS
    }


def test_pads_press_with_the_grip_force(carry: Case) -> None:
    """MuJoCo's own contact forces, half a second after the grasp."""
    conditions = ExecutionConditions(grip_force=40.0)
    layout = qpos_layout(carry.scene)
    model = build_execution_model(carry.scene, conditions)
    timeline = attachment_timeline(carry.scene, carry.actions, carry.motion, CHECKS)
    grips = grip_intervals(carry.motion, timeline, layout)
    commands = servo_commands(model, carry.scene, carry.motion, grips, conditions, 10.0)
    data = mujoco.MjData(model)
    data.qpos[:] = carry.motion.qpos[0]
    until = carry.motion.time[carry.motion.switch[0]] + 0.5
    for targets in commands.targets[: round(until / model.opt.timestep)]:
        data.ctrl[:] = targets
        mujoco.mj_step(model, data)

    body = model.body(object_body_name("yellow")).id
    pressing = {"left/finger_left": 0.0, "left/finger_right": 0.0}
    force = np.zeros(6)
    for index, contact in enumerate(data.contact):
        bodies = {int(model.geom_bodyid[geom]) for geom in contact.geom}
        names = {model.body(other).name for other in bodies - {body}} & set(pressing)
        if body in bodies and names:
            mujoco.mj_contactForce(model, data, index, force)
            pressing[names.pop()] += force[0]
    assert list(pressing.values()) == pytest.approx([40.0, 40.0], rel=0.1)


def test_an_object_that_is_carried_on_an_arc_stays_in_the_fingers(carry: Case) -> None:
    """The hand swings around its base at 1.8 m/s; the object moves by less than 0.5 mm in it."""
    layout = qpos_layout(carry.scene)
    planned = carry.motion.qpos
    grasped, placed = carry.motion.switch
    lifted = (grasped + placed) // 2

    # From rest to rest: the object is lifted, then the first joint of the left arm turns by 2.4 rad.
    step = carry.motion.step
    tau = np.linspace(0, 1, round(1.5 / step) + 1)[1:]
    law = tau**3 * (10 - 15 * tau + 6 * tau**2)
    lift = interp1d(np.arange(len(planned)), planned, axis=0)(grasped + law * (lifted - grasped))
    swing = np.repeat(planned[[lifted]], len(law), axis=0)
    swing[:, layout.arm_joints[0, 0]] -= 2.4 * law
    qpos = np.concatenate([planned[: grasped + 1], lift, swing])
    motion = Motion(step * np.arange(len(qpos)), qpos, np.array([grasped]))
    states = execute(carry.scene, carry.actions[:1], motion).qpos[: len(qpos)]

    model = build_execution_model(carry.scene, ExecutionConditions())
    data = mujoco.MjData(model)
    in_hand = []
    speeds = []
    for state in states[[grasped + len(law), *range(len(qpos) - len(law), len(qpos))]]:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        hand = data.body("left/hand")
        object_ = data.body(object_body_name("yellow"))
        in_hand.append(hand.xmat.reshape(3, 3).T @ (object_.xpos - hand.xpos))
        speeds.append(object_.xpos.copy())
    fastest = np.linalg.norm(np.diff(speeds[1:], axis=0), axis=1).max() / step
    assert fastest > 1.5
    assert np.linalg.norm(np.diff(in_hand, axis=0).sum(axis=0)) < 5e-4


def test_a_fast_wrist_stays_on_its_path(carry: Case) -> None:
    """Joint 5 has 12 N m for its own inertia: at 2.4 rad/s, the lag is below a degree, and none at rest again."""
    layout = qpos_layout(carry.scene)
    joint = layout.arm_joints[0][4]
    time = 0.02 * np.arange(61)
    phase = np.clip(time / 1.0, 0, 1)
    qpos = np.tile(carry.motion.qpos[0], (len(time), 1))
    qpos[:, joint] += 1.28 * (10 * phase**3 - 15 * phase**4 + 6 * phase**5)
    motion = make_motion(time, qpos, [])
    assert np.abs(np.gradient(qpos[:, joint], time)).max() == pytest.approx(2.4, rel=0.01)

    states = execute(carry.scene, [], motion).qpos
    error = np.abs(states[: len(time), joint] - qpos[:, joint])
    assert error.max() < np.deg2rad(1)
    assert error[-1] < 2e-3


def test_resting_arms_and_objects_stay_where_they_are(carry: Case) -> None:
    still = Motion(
        0.1 * np.arange(20), np.repeat(carry.motion.qpos[:1], 20, axis=0), np.zeros(0, int)
    )
    states = execute(carry.scene, (), still).qpos
    assert np.abs(states - states[0]).max() < 3e-4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"friction": -0.1}, "the friction is -0.1; valid is 0 to 10."),
        ({"friction": float("nan")}, "the friction is nan"),
        ({"grip_force": 71.0}, "the grip force is 71 N; valid is 1 to 70 N."),
        ({"object_noise": 1.0}, "the object noise is 1 m; valid is 0 to 0.1 m."),
        ({"seed": -1}, "the seed is -1; valid is 0 or more."),
    ],
)
def test_conditions_that_are_no_physics_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        ExecutionConditions(**values)
