"""Executions in MJX against those in MuJoCo C: the same records, verdicts and causes, and clear refusals.

MJX compiles for half a minute for each model, so one small batch serves the tests that need a simulation: a workcell
of one arm, which grasps and lifts a box. The whole motion of two arms is a slow test.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import mjx
from puppet import STEP, Case, Puppet, hand

from dvr_jax.checker.operators import CHECKS
from dvr_jax.errors import OptionError
from dvr_jax.execution import DeviationCause, Execution, ExecutionConditions, execute
from dvr_jax.execution.backend import PhysicsBackend
from dvr_jax.execution.diagnosis import differences
from dvr_jax.execution.mjx_batch import execute_batch
from dvr_jax.execution.mjx_model import (
    build_mjx_model,
    contact_limit,
    put_on_device,
    stack_friction,
)
from dvr_jax.execution.mjx_records import NO_CONTACT, BatchRecorder, StepRecords
from dvr_jax.execution.physics_model import build_execution_model
from dvr_jax.execution.repetition import ConditionRange, execute_repeatedly
from dvr_jax.execution.task import prepare_task
from dvr_jax.logic import Action
from dvr_jax.motion import make_motion
from dvr_jax.scene.types import FixedBody, OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.workcell import SINGLE_ARM_WORKCELL

HOLDING = ExecutionConditions(object_noise=0.001, seed=3)
"""The gripper holds the box, which stands a millimeter beside its place at first."""

SLIPPERY = ExecutionConditions(friction=0.005, object_noise=0.001, seed=4)
"""The pads hold 0.7 N; the box weighs 1.2 N."""


def lifted_box() -> Case:
    """One arm, whose open gripper is around a box at the start, closes it and lifts the box."""
    box = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (0.0, 0.15), 0.0)
    goal = OnRegion("yellow", Region((0.2, 0.15), 0.0, (0.14, 0.14)))
    puppet = Puppet(Scene((box,), goal, SINGLE_ARM_WORKCELL))
    downwards = hand((1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    puppet.reach(0, downwards, np.array([0.0, 0.15, 0.20]))
    puppet.reach(0, downwards, np.array([0.0, 0.15, 0.07]))
    begin = len(puppet.samples) - 1
    puppet.fingers(0, 0.025)
    puppet.attach(0, 0)
    puppet.reach(0, downwards, np.array([0.0, 0.15, 0.20]))

    # The way to the box, which takes two seconds of simulation, is left out.
    qpos = np.stack(puppet.samples[begin:])
    motion = make_motion(STEP * np.arange(len(qpos)), qpos, [puppet.switch[0] - begin])
    return Case(puppet.scene, (Action("grasp", ("arm", "+x", "yellow")),), motion)


@pytest.fixture(scope="module")
def lift() -> Case:
    return lifted_box()


@pytest.fixture(scope="module")
def pairs(lift: Case) -> list[tuple[Execution, Execution]]:
    """The executions in MuJoCo C and in MJX under the conditions HOLDING and SLIPPERY."""
    conditions = (HOLDING, SLIPPERY)
    in_c = [execute(lift.scene, lift.actions, lift.motion, each) for each in conditions]
    in_mjx = execute_batch(lift.scene, lift.actions, lift.motion, conditions)
    return list(zip(in_c, in_mjx, strict=True))


def test_a_held_object_moves_as_in_mujoco_c(pairs: list[tuple[Execution, Execution]]) -> None:
    in_c, in_mjx = pairs[0]
    np.testing.assert_allclose(in_mjx.time, in_c.time)
    # The same seed draws the same displacement.
    np.testing.assert_allclose(in_mjx.qpos[0], in_c.qpos[0], atol=1e-12)
    assert in_mjx.report.is_stable
    assert (in_mjx.report.succeeded, in_mjx.report.deviation) == (
        in_c.report.succeeded,
        in_c.report.deviation,
    )
    [in_c_result] = in_c.report.objects
    [in_mjx_result] = in_mjx.report.objects
    assert in_mjx_result.displacement == pytest.approx(in_c_result.displacement, abs=1e-3)
    # Joints [rad], fingers and the box's position [m], and its turn [rad], in all records.
    assert np.abs(in_mjx.qpos[:, :-4] - in_c.qpos[:, :-4]).max() < 2e-3
    _, turn = differences(in_mjx.qpos[:, -7:], in_c.qpos[:, -7:])
    assert turn.max() < 0.02
    assert in_mjx.qpos[-1, -5] > in_mjx.qpos[0, -5] + 0.05


def test_an_object_slips_as_in_mujoco_c(pairs: list[tuple[Execution, Execution]]) -> None:
    in_c, in_mjx = (each.report.deviation for each in pairs[1])
    assert in_c is not None and in_mjx is not None
    assert in_c.cause in (DeviationCause.MISSED, DeviationCause.SLIPPED)
    assert (in_mjx.object, in_mjx.cause) == (in_c.object, in_c.cause)
    assert in_mjx.time == pytest.approx(in_c.time, abs=0.1)
    assert in_mjx.touched_by == in_c.touched_by


@pytest.mark.slow
def test_repeated_handovers_end_as_in_mujoco_c(handover: Case) -> None:
    variation = ConditionRange(object_noise=0.001, friction=(0.6, 1.2), seed=2)
    lines: list[str] = []
    in_c, in_mjx = (
        list(
            execute_repeatedly(
                handover.scene,
                handover.actions,
                handover.motion,
                variation,
                number=2,
                workers=1,
                backend=backend,
                report_progress=lines.append,
            )
        )
        for backend in PhysicsBackend
    )
    for first, second in zip(in_c, in_mjx, strict=True):
        assert second.succeeded == first.succeeded
        assert second.deviation == first.deviation
        assert second.objects[0].displacement == pytest.approx(
            first.objects[0].displacement, abs=2e-3
        )
    assert lines[0].startswith("compiling the simulation for 2 copies")
    assert lines[-1].startswith("simulated 100 % of the steps")


def test_copies_have_the_friction_of_their_conditions(lift: Case) -> None:
    """Nothing else in the model depends on the conditions, so a batch needs no other field of its own."""
    models = [build_execution_model(lift.scene, each) for each in (HOLDING, SLIPPERY)]
    friction = stack_friction(lift.scene, (HOLDING, SLIPPERY))
    for copy, model in enumerate(models):
        np.testing.assert_allclose(friction.geom[copy], model.geom_friction)
        np.testing.assert_allclose(friction.pair[copy], model.pair_friction)

    differing = set()
    for name in dir(models[0]):
        values = [getattr(model, name) for model in models]
        if isinstance(values[0], np.ndarray) and not np.array_equal(*values):
            differing.add(name)
    assert differing == {"geom_friction", "pair_friction"}


def test_touches_belong_to_the_record_after_them(lift: Case) -> None:
    """The chunks in which the steps arrive make no difference."""
    model = build_mjx_model(lift.scene, HOLDING)
    task = prepare_task(lift.scene, lift.actions, lift.motion, CHECKS)
    first, second = task.record_steps(model.opt.timestep)[1:3]
    steps = second + 5
    touching = np.full((steps, 1, 2), NO_CONTACT)
    touching[first - 1, 0, 0] = 2 * model.nbody + 3
    touching[first, 0, 1] = 4 * model.nbody + 5
    records = StepRecords(
        qpos=np.arange(steps, dtype=float)[:, None, None] * np.ones((1, 1, model.nq)),
        touching=touching,
        is_stable=np.ones((steps, 1), bool),
        is_crowded=np.zeros((steps, 1), bool),
    )
    for chunk in (steps, 7):
        recorder = BatchRecorder(task, model, copies=1)
        for begin in range(0, steps, chunk):
            recorder.add(begin, StepRecords(*(each[begin : begin + chunk] for each in records)))
        simulated = recorder.simulated(0)
        assert simulated.states[:3, 0].tolist() == [0.0, first, second]
        assert simulated.touches == [frozenset(), frozenset({(2, 3)}), frozenset({(4, 5)})]
        assert simulated.is_stable and not recorder.is_crowded[0]


def test_one_step_decides_whether_a_copy_is_stable_and_crowded(lift: Case) -> None:
    model = build_mjx_model(lift.scene, HOLDING)
    task = prepare_task(lift.scene, lift.actions, lift.motion, CHECKS)
    recorder = BatchRecorder(task, model, copies=2)
    for first in (0, 1, 2):
        flags = np.array([[False, first == 1]])
        recorder.add(
            first,
            StepRecords(
                qpos=np.zeros((1, 2, model.nq)),
                touching=np.full((1, 2, 3), NO_CONTACT),
                is_stable=~flags,
                is_crowded=flags,
            ),
        )
    assert [recorder.simulated(copy).is_stable for copy in (0, 1)] == [True, False]
    assert recorder.is_crowded.tolist() == [False, True]


def test_cylinders_are_refused(carry: Case, lift: Case) -> None:
    with pytest.raises(
        OptionError, match="cannot simulate the cylinder 'object/can', as it has no"
    ):
        execute_batch(carry.scene, carry.actions, carry.motion, [HOLDING])
    post = FixedBody("post", "cylinder", (0.02, 0.2), (0.9, 0.9, 0.1), 0.0)
    with pytest.raises(
        OptionError, match=r"cylinder 'fixed/post'.*valid are boxes, or the backend"
    ):
        build_mjx_model(replace(lift.scene, fixed=(post,)), HOLDING)


def test_other_gaps_of_mjx_are_refused() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><option integrator="implicit"/></mujoco>')
    with pytest.raises(OptionError, match=r"cannot simulate this workcell .*valid is the backend"):
        put_on_device(model)


def test_a_batch_has_one_grip_force(lift: Case) -> None:
    with pytest.raises(OptionError, match=r"are \[40.0, 70.0\] N; valid is one force"):
        execute_batch(
            lift.scene, lift.actions, lift.motion, [HOLDING, replace(HOLDING, grip_force=40.0)]
        )


def test_contacts_are_reserved_for_standing_and_held_objects(carry: Case) -> None:
    scene = replace(carry.scene, objects=carry.scene.objects[:1])
    data = mjx.make_data(put_on_device(build_mjx_model(scene, HOLDING)))
    assert data._impl.contact.dist.shape == (contact_limit(scene),)
    assert contact_limit(carry.scene) == contact_limit(scene) + 4
