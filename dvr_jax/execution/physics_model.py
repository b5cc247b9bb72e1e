"""The MuJoCo model in which a plan is executed: the scene's own model, made fit for forces.

The scene's model serves kinematics. For execution it gets

- time steps of 0.5 ms, an implicit integrator and elliptic friction cones;
- arms without weight and without friction in their joints, as Franka's controller compensates both (the commands of
  libfranka's `franka::Torques` are torques "without gravity and friction"). The servos damp the motion;
- fingers with the shape that they have: where a robot shows its fingers, what is shown collides in place of the
  capsules, which reach beyond the pads;
- flat finger pads. Their contacts are stiff and their parameters take precedence: with MuJoCo's default contacts, a
  held object drifts by a centimeter in the course of a plan;
- fingers that are coupled, with the inertia of their drive (about 2 kg): light fingers press into what they hold;
- joint targets without limits, since the target of a servo leads its joint.
"""

from __future__ import annotations

import mujoco
import numpy as np

from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.scene.mjcf import COLLISION_GROUP, LOOKS_GROUP, build_model_spec, object_body_name
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import FINGERS

TIME_STEP = 0.0005
"""Time step of the simulation [s]."""

FINGER_INERTIA = 1.0
"""Inertia of the drive that each of the two fingers feels [kg]."""

PAD_HALF_SIZE = (0.0085, 0.004, 0.009)
"""Half extents of a finger's pad across the finger, along the closing axis, and along the finger [m]."""

PAD_CONTACT_TIME = 0.004
"""Time constant of the contacts of a pad [s]; at least twice the time step."""

PAD_FRICTION_TIME = 2 * TIME_STEP
"""Time constant of the friction of a pad [s], the shortest that is stable.

MuJoCo's friction brakes the sliding speed but neglects the turning of the contact's axes, so that an object that is
carried on an arc creeps at half this time constant times the centripetal acceleration: 2 cm/s with 4 ms and 10 m/s^2.
"""

PAD_TORSION = 2 / 3 * PAD_HALF_SIZE[0]
"""Torsional friction of a pad as a multiple of its sliding friction [m]: a disc of the radius R that presses evenly
resists a turn about its axis with the torque ``2/3 friction R force``."""

TORSION = 0.005
"""Coefficient of torsional friction of all other bodies, MuJoCo's default [m]."""

ROLLING = 0.0001
"""Coefficient of rolling friction, MuJoCo's default [m]."""


def build_execution_model(scene: Scene, conditions: ExecutionConditions) -> mujoco.MjModel:
    """Compile the model in which plans of a scene are executed.

    Its `qpos` is laid out as that of the scene's own model.

    Args:
        scene: The scene.
        conditions: Factor of the friction.
    """
    return build_execution_spec(scene, conditions).compile()


def build_execution_spec(scene: Scene, conditions: ExecutionConditions) -> mujoco.MjSpec:
    """Build this model as an editable specification.

    Args:
        scene: The scene.
        conditions: Factor of the friction.
    """
    spec = build_model_spec(scene)
    spec.option.timestep = TIME_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0

    for geom in spec.geoms:
        geom.friction = [conditions.friction, TORSION, ROLLING]
    for item in scene.objects:
        for geom in spec.body(object_body_name(item.name)).geoms:
            # The object's friction counts, whatever it touches.
            geom.friction = [conditions.friction * item.friction, TORSION, ROLLING]
            geom.priority = 1

    for arm in scene.workcell.arm_names:
        _compensate_gravity(spec.body(f"{arm}/base"))
        for number in range(scene.workcell.robot.number_of_joints):
            joint = spec.joint(f"{arm}/joint{number + 1}")
            joint.damping = np.zeros_like(joint.damping)
            joint.frictionloss = 0.0
        for finger in FINGERS:
            _add_pad(spec, f"{arm}/{finger}")
            for item in scene.objects:
                friction = conditions.friction * item.friction
                _let_pad_hold(spec, f"{arm}/{finger}_pad", object_body_name(item.name), friction)
        _couple_fingers(spec, arm)

    # The target of a servo leads its joint by the product of the joint's speed and of the servo's time constant.
    for actuator in spec.actuators:
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE

    return spec


def _compensate_gravity(body: mujoco.MjsBody) -> None:
    """Compensate the weight of a body and of all bodies that it carries."""
    body.gravcomp = 1.0
    child = body.first_body()
    while child is not None:
        _compensate_gravity(child)
        child = body.next_body(child)


def _add_pad(spec: mujoco.MjSpec, finger: str) -> None:
    """Put a flat pad on the inner side of a finger, around the gripper center."""
    body = spec.body(finger)
    looks = [geom for geom in body.geoms if geom.group == LOOKS_GROUP]
    for geom in body.geoms if looks else []:
        collides = int(geom.group == LOOKS_GROUP)
        geom.contype = collides
        geom.conaffinity = collides

    joint = body.joints[0]
    joint.armature = FINGER_INERTIA

    # The inner side of a closed finger lies in the hand's middle plane, and the joint's axis points away from it.
    outwards = float(joint.axis[1])
    hand_to_center = float(spec.site(finger.rpartition("/")[0] + "/gripper").pos[2])
    along = hand_to_center - float(body.pos[2])
    body.add_geom(
        name=f"{finger}_pad",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[0.0, outwards * PAD_HALF_SIZE[1], along],
        size=list(PAD_HALF_SIZE),
        group=COLLISION_GROUP,
        mass=0.0,
        condim=4,
    )


def _let_pad_hold(spec: mujoco.MjSpec, pad: str, item: str, friction: float) -> None:
    """State how a pad and an object touch: stiff, and with the torsional friction of a disc."""
    torsion = PAD_TORSION * friction
    spec.add_pair(
        geomname1=pad,
        geomname2=item,
        condim=4,
        friction=[friction, friction, torsion, ROLLING, ROLLING],
        solref=[PAD_CONTACT_TIME, 1.0],
        solreffriction=[PAD_FRICTION_TIME, 1.0],
        solimp=[0.99, 0.999, 0.0005, 0.5, 2.0],
    )


def _couple_fingers(spec: mujoco.MjSpec, arm: str) -> None:
    """Let both fingers of an arm travel by the same distance."""
    left, right = (f"{arm}/{finger.replace('finger', 'finger_joint')}" for finger in FINGERS)
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=left,
        name2=right,
        data=[0.0, 1.0, *[0.0] * (mujoco.mjNEQDATA - 2)],
        solref=[PAD_CONTACT_TIME, 1.0],
    )
