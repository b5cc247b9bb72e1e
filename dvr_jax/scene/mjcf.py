"""A scene as a MuJoCo model: table, arms, objects as free bodies, fixed bodies, the goal region, light and camera.

The order of `qpos` is described in `dvr_jax.scene.layout`. The keyframe "home" is the initial state.

Geom groups: 0 goal region (nothing touches it), 1 table, objects and fixed bodies, 2 the arms' looks, 3 the arms'
collision capsules. Names of bodies and geoms: those of an arm as in the robot's MJCF after ``<arm>/``; "table"; "goal";
``object/<name>`` for an object (its free joint: ``object/<name>/joint``) and ``fixed/<name>`` for a fixed body, where
the name is percent-encoded outside letters, digits and "_.-~".
"""

import copy
import math
from functools import lru_cache
from urllib.parse import quote, unquote

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.errors import SceneError
from dvr_jax.goals import GOAL_REGION
from dvr_jax.scene.colors import FIXED_COLOR, Color, object_colors, region_colors
from dvr_jax.scene.layout import Layout, home_qpos, qpos_layout, yaw_quaternion
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import FixedBody, Scene, SceneObject
from dvr_jax.shapes import Shape, Size
from dvr_jax.workcell.robot import FINGERS, Robot

__all__ = [
    "COLLISION_GROUP",
    "GOAL_GROUP",
    "LOOKS_GROUP",
    "SOLID_GROUP",
    "Layout",
    "build_collision_model",
    "build_home_data",
    "build_model",
    "build_model_spec",
    "fixed_body_name",
    "home_qpos",
    "object_body_name",
    "qpos_layout",
    "require_free_home",
    "scene_xml",
]

GOAL_GROUP = 0
"""Geom group of the goal region."""

SOLID_GROUP = 1
"""Geom group of table, objects and fixed bodies."""

LOOKS_GROUP = 2
"""Geom group of what is seen of the arms; it never collides."""

COLLISION_GROUP = 3
"""Geom group of the arms' collision capsules; they are never seen."""

TABLE_COLOR: Color = (0.80, 0.77, 0.72)
"""Color of the table."""

GOAL_THICKNESS = 0.001
"""Thickness of the geom that shows the goal region [m]."""

LEAST_MASS = 1e-6
"""Least mass [kg] and moment of inertia [kg m^2] of a body in a model whose masses play no part."""

HOME_PENETRATION = 1e-3
"""Deepest penetration that is accepted in the initial state [m]."""


def object_body_name(name: str) -> str:
    """Name of an object's body and geom in the model; distinct for distinct names, safe in XML."""
    return "object/" + _encoded(name)


def fixed_body_name(name: str) -> str:
    """Name of a fixed body's body and geom in the model; distinct for distinct names, safe in XML."""
    return "fixed/" + _encoded(name)


def build_model_spec(scene: Scene, looks: bool = True) -> mujoco.MjSpec:
    """Build a scene's model as an editable specification.

    Args:
        scene: The scene.
        looks: Whether the model has the geoms that are only seen: the looks of the arms, and the goal region.

    Returns:
        The specification.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "dvr_scene"
    spec.compiler.degree = False
    spec.option.timestep = 0.002
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 960

    _add_light_and_camera(spec.worldbody)
    _add_table(spec.worldbody, scene)
    _attach_arms(spec, scene, looks)

    for item, color in zip(scene.objects, object_colors(scene), strict=True):
        _add_object(spec.worldbody, scene, item, color)

    for body in scene.fixed:
        _add_fixed_body(spec.worldbody, body)

    if looks:
        _add_regions(spec.worldbody, scene)

    qpos = home_qpos(scene)
    spec.add_key(name="home", qpos=qpos, ctrl=_home_controls(spec, scene, qpos))

    return spec


@lru_cache(maxsize=64)
def build_model(scene: Scene) -> mujoco.MjModel:
    """Compile a scene's model, which is kept and shared: not to be changed (`build_model_spec` gives an own one)."""
    return build_model_spec(scene).compile()


def build_collision_model(scene: Scene) -> mujoco.MjModel:
    """Compile a scene's model without what is only seen; every call returns a new one, which may be changed.

    Its bodies, joints and sites are those of `build_model`, in the same order. Of the geoms it has those that collide,
    about a quarter, so that MuJoCo finds contacts several times as fast.
    """
    return build_model_spec(scene, looks=False).compile()


def build_home_data(model: mujoco.MjModel) -> mujoco.MjData:
    """State of a model at its keyframe "home", with all positions computed."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)

    return data


def require_free_home(scene: Scene) -> None:
    """Refuse a scene in whose initial state two bodies penetrate: no motion could start there.

    Raises:
        SceneError: Two bodies penetrate by more than `HOME_PENETRATION`; the message names the deepest pair.
    """
    model = copy.copy(build_model(scene))
    # With several contact points for each pair of a cylinder, all of them can lie less deep than the pair does.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
    data = mujoco.MjData(model)
    data.qpos[:] = home_qpos(scene)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)

    distance = np.array(data.contact.dist)
    if distance.min(initial=0.0) > -HOME_PENETRATION:
        return

    deepest = int(distance.argmin())
    bodies = model.geom_bodyid[data.contact.geom[deepest]]
    first, second = (_decoded(model.body(body).name) for body in bodies)
    raise SceneError(
        f"with the arms at home {first} and {second} penetrate by {-1e3 * distance[deepest]:.0f} mm; "
        "move one of them or choose another home."
    )


def scene_xml(scene: Scene) -> str:
    """Write a scene as self-contained MJCF for any MuJoCo: the model of `build_model` to six digits."""
    spec = build_model_spec(scene)
    spec.compile()

    return str(spec.to_xml())


def _add_light_and_camera(world: mujoco.MjsBody) -> None:
    world.add_light(
        name="key",
        pos=[-0.6, -1.2, 2.6],
        dir=[0.22, 0.42, -0.88],
        diffuse=[0.8, 0.8, 0.8],
    )
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, SCENE_CAMERA.rotation().ravel())
    world.add_camera(
        name="scene",
        pos=list(SCENE_CAMERA.position),
        quat=quaternion,
        fovy=math.degrees(
            SCENE_CAMERA.field_of_view
        ),  # MjSpec takes degrees, whatever its compiler is told
    )


def _add_table(world: mujoco.MjsBody, scene: Scene) -> None:
    table = scene.workcell.table
    body = world.add_body(name="table", pos=[0.0, 0.0, -table.thickness / 2])
    body.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[*table.half_extents, table.thickness / 2],
        group=SOLID_GROUP,
        rgba=[*TABLE_COLOR, 1.0],
    )


def _attach_arms(spec: mujoco.MjSpec, scene: Scene, looks: bool) -> None:
    robot = _robot_spec(scene.workcell.robot, looks)
    for arm in scene.workcell.arms:
        frame = spec.worldbody.add_frame(pos=[*arm.position, 0.0], quat=yaw_quaternion(arm.yaw))
        spec.attach(robot.copy(), prefix=f"{arm.name}/", frame=frame)


def _add_object(world: mujoco.MjsBody, scene: Scene, item: SceneObject, color: Color) -> None:
    name = object_body_name(item.name)
    position = list(scene.center_of(item))
    body = world.add_body(name=name, pos=position, quat=yaw_quaternion(item.yaw))
    body.add_freejoint(name=f"{name}/joint")
    geom_type, size = _geom_of(item.kind, item.size)
    body.add_geom(
        name=name,
        type=geom_type,
        size=size,
        group=SOLID_GROUP,
        rgba=[*color, 1.0],
        density=item.density,
        condim=4,
    )


def _add_fixed_body(world: mujoco.MjsBody, fixed: FixedBody) -> None:
    name = fixed_body_name(fixed.name)
    body = world.add_body(name=name, pos=list(fixed.position), quat=yaw_quaternion(fixed.yaw))
    geom_type, size = _geom_of(fixed.kind, fixed.size)
    body.add_geom(
        name=name,
        type=geom_type,
        size=size,
        group=SOLID_GROUP,
        rgba=[*FIXED_COLOR, 1.0],
    )


def _add_regions(world: mujoco.MjsBody, scene: Scene) -> None:
    for item, color in zip(scene.all_regions, region_colors(scene), strict=True):
        region = item.footprint
        world.add_geom(
            name=item.name if item.name == GOAL_REGION else f"region {item.name}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*region.center, scene.height_of_top(item.support)],
            quat=yaw_quaternion(region.yaw),
            size=[*region.half, GOAL_THICKNESS / 2],
            group=GOAL_GROUP,
            rgba=[*color, 1.0],
            # Like the looks of the arms: the geom meets nothing, yet has a bounding box for mj_multiRay.
            contype=2,
            conaffinity=0,
        )


def _geom_of(shape: Shape, size: Size) -> tuple[mujoco.mjtGeom, list[float]]:
    """MuJoCo's type and size of the geom of a body."""
    name, numbers = shape.mujoco_geom(size)
    return getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}"), numbers


def _home_controls(
    spec: mujoco.MjSpec, scene: Scene, qpos: Float[np.ndarray, " nq"]
) -> list[float]:
    """Targets that hold the initial state, one for each position actuator."""
    layout = qpos_layout(scene)
    targets: dict[str, float] = {}

    for index, arm in enumerate(scene.workcell.arms):
        joints = [f"joint{i + 1}" for i in range(layout.arm_joints.shape[1])]
        fingers = [finger.replace("finger", "finger_joint") for finger in FINGERS]
        angles = [*qpos[layout.arm_joints[index]], *qpos[layout.fingers[index]]]
        targets |= {
            f"{arm.name}/{name}": float(angle)
            for name, angle in zip(joints + fingers, angles, strict=True)
        }

    return [targets.get(actuator.target, 0.0) for actuator in spec.actuators]


def _encoded(name: str) -> str:
    return quote(name, safe="", errors="surrogatepass")


def _decoded(body: str) -> str:
    """Name of a body as a person wrote it."""
    return unquote(body) if body.startswith(("object/", "fixed/")) else body


@lru_cache(maxsize=16)
def _robot_spec(robot: Robot, looks: bool) -> mujoco.MjSpec:
    """Specification of one arm, with or without the geoms that never collide; only to be copied."""
    spec = mujoco.MjSpec.from_string(robot.mjcf)
    # Numbers and texts under <custom> are meant for `Robot`; a scene would hold them once for each arm.
    for element in [*spec.numerics, *spec.texts]:
        spec.delete(element)
    if not looks:
        # MuJoCo requires a mass of every moving body, also where it would follow from geoms that are left out.
        spec.compiler.boundmass = LEAST_MASS
        spec.compiler.boundinertia = LEAST_MASS
        for geom in [geom for geom in spec.geoms if not geom.contype & geom.conaffinity]:
            spec.delete(geom)

    return spec
