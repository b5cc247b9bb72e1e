"""A scene as a MuJoCo model: table, two Pandas, the objects as free bodies, the goal region, light and camera.

Order of `qpos` (see `Layout`): left arm 7, its fingers 2, right arm 7, its fingers 2, then 7 for each object (position
of its centre in the world, unit quaternion w x y z), so nq = 18 + 7 N. The keyframe "home" is the initial state.

Geom groups: 0 goal spot (look only), 1 table and objects, 2 the arms' looks, 3 the arms' collision capsules.
Bodies and geoms: "left/..." and "right/..." as in `panda.xml`; "table"; "object/<name>" for an object's body, geom (and
"object/<name>/joint" for its free joint) with the name percent-encoded outside letters, digits and "_.-~"; geom "goal".
"""

import copy
import math
from dataclasses import dataclass
from functools import lru_cache
from urllib.parse import quote, unquote

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.scene.colours import GOAL_COLOUR, object_colours
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import FixedBody, Scene, SceneObject

GOAL_GROUP, SOLID_GROUP, LOOKS_GROUP, COLLISION_GROUP = 0, 1, 2, 3
"""Geom groups, as listed in the module's docstring."""

CAPSULE_NAMES: tuple[str, ...] = (
    "column_collision",
    "upper_arm_collision",
    "elbow_collision",
    "forearm_collision",
    "wrist_collision",
    "flange_collision",
    "hand_collision",
    "finger_left_collision",
    "finger_right_collision",
)
"""The nine collision capsules of an arm, from the base outwards; a model's names carry the arm's prefix."""

GOAL_SPOT_THICKNESS = 0.001

HOME_PENETRATION = 1e-3
"""Deepest penetration in the initial state (m)."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where each quantity lies in `qpos`; the same for every scene with as many objects."""

    arm_joints: NDArray[np.intp]
    """Indices of the revolute joints (2, 7)."""
    fingers: NDArray[np.intp]
    """Indices of the finger joints (2, 2): travel of finger_left and finger_right, m."""
    objects: NDArray[np.intp]
    """Indices of the objects' free joints (N, 7): x y z, quaternion w x y z."""

    @property
    def size(self) -> int:
        """nq."""
        return int(self.arm_joints.size + self.fingers.size + self.objects.size)


def qpos_layout(scene: Scene) -> Layout:
    """Layout of the state of a scene's model."""
    workcell = scene.workcell
    number_of_objects = len(scene.objects)
    joints = workcell.robot.number_of_joints
    arms = workcell.number_of_arms
    starts = np.arange(arms)[:, None] * (joints + 2)
    first_object = arms * (joints + 2)
    return Layout(
        arm_joints=starts + np.arange(joints),
        fingers=starts + joints + np.arange(2),
        objects=first_object + np.arange(7 * number_of_objects).reshape(number_of_objects, 7),
    )


def object_body_name(name: str) -> str:
    """Name of an object's body and geom in the model; distinct for distinct names, safe in XML."""
    return "object/" + quote(name, safe="", errors="surrogatepass")


def home_qpos(scene: Scene, finger_travel: float | None = None) -> NDArray[np.float64]:
    """The scene's initial state (nq): home postures, open fingers, objects upright where they stand."""
    layout = qpos_layout(scene)
    qpos = np.zeros(layout.size)
    qpos[layout.arm_joints] = scene.home
    qpos[layout.fingers] = scene.workcell.robot.finger_travel if finger_travel is None else finger_travel
    for indices, item in zip(layout.objects, scene.objects, strict=True):
        qpos[indices] = [*item.center, *_yaw_quaternion(item.yaw)]
    return qpos


def build_model_spec(scene: Scene) -> mujoco.MjSpec:
    """The scene as an editable model specification."""
    spec = mujoco.MjSpec()
    spec.modelname = "dvr_scene"
    spec.compiler.degree = False
    spec.option.timestep = 0.002
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    world = spec.worldbody
    world.add_light(name="key", pos=[-0.6, -1.2, 2.6], dir=[0.22, 0.42, -0.88], diffuse=[0.8, 0.8, 0.8])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, SCENE_CAMERA.rotation().ravel())
    fovy = math.degrees(SCENE_CAMERA.field_of_view)  # MjSpec takes it in degrees, whatever the compiler is told
    world.add_camera(name="scene", pos=list(SCENE_CAMERA.position), quat=quaternion, fovy=fovy)
    slab = scene.workcell.table
    table_half = [*slab.half_extents, slab.thickness / 2]
    table = world.add_body(name="table", pos=[0.0, 0.0, -slab.thickness / 2])
    table.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=table_half, group=SOLID_GROUP, rgba=[0.80, 0.77, 0.72, 1.0]
    )
    for arm in scene.workcell.arms:
        frame = world.add_frame(pos=[*arm.position, 0.0], quat=_yaw_quaternion(arm.yaw))
        spec.attach(mujoco.MjSpec.from_string(scene.workcell.robot.mjcf), prefix=f"{arm.name}/", frame=frame)
    for body in scene.fixed:
        _add_fixed(world, body)
    for item, colour in zip(scene.objects, object_colours(scene), strict=True):
        _add_object(world, item, colour)
    _add_goal(world, scene)
    qpos = home_qpos(scene)
    arms = qpos[: qpos_layout(scene).size - 7 * len(scene.objects)]  # one actuator a joint, in the joints' order
    spec.add_key(name="home", qpos=qpos, ctrl=arms)
    return spec


@lru_cache(maxsize=64)
def build_model(scene: Scene) -> mujoco.MjModel:
    """The scene's compiled model, kept and shared: not to be changed (`build_model_spec` gives one of your own)."""
    return build_model_spec(scene).compile()


def build_home_data(model: mujoco.MjModel) -> mujoco.MjData:
    """The model's state at its keyframe "home", with all positions computed."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    return data


def require_free_home(scene: Scene) -> None:
    """Raise a DvrError where something collides in the initial state: no motion could start there."""
    model = copy.copy(build_model(scene))
    # Several points of contact of a pair with a cylinder can all lie less deep than the pair's.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
    data = mujoco.MjData(model)
    data.qpos[:] = home_qpos(scene)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    distance = np.array(data.contact.dist)
    if distance.min(initial=0.0) > -HOME_PENETRATION:
        return
    deepest = int(distance.argmin())
    first, second = (unquote(model.body(body).name) for body in model.geom_bodyid[data.contact.geom[deepest]])
    raise DvrError(
        f"with the arms at home {first} and {second} penetrate by {-1e3 * distance[deepest]:.0f} mm; "
        "move the object or choose another home."
    )


def scene_xml(scene: Scene) -> str:
    """The scene as self-contained MJCF, for any MuJoCo: the model of `build_model` to the six digits written."""
    spec = build_model_spec(scene)
    spec.compile()
    return str(spec.to_xml())


def _add_object(world: mujoco.MjsBody, item: SceneObject, colour: tuple[float, float, float]) -> None:
    name = object_body_name(item.name)
    body = world.add_body(name=name, pos=list(item.center), quat=_yaw_quaternion(item.yaw))
    body.add_freejoint(name=f"{name}/joint")
    kind, size = _geom(item)
    body.add_geom(name=name, type=kind, size=size, group=SOLID_GROUP, rgba=[*colour, 1.0], density=300.0, condim=4)


def _geom(item: SceneObject | FixedBody) -> tuple[mujoco.mjtGeom, list[float]]:
    name, size = item.kind.mujoco_geom(item.size)
    return getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}"), [*size, 0.0][:3]


def _add_fixed(world: mujoco.MjsBody, item: FixedBody) -> None:
    name = "fixed/" + quote(item.name, safe="", errors="surrogatepass")
    body = world.add_body(name=name, pos=list(item.position), quat=_yaw_quaternion(item.yaw))
    kind, size = _geom(item)
    body.add_geom(name=name, type=kind, size=size, group=SOLID_GROUP)


def _add_goal(world: mujoco.MjsBody, scene: Scene) -> None:
    region = scene.goal.region
    world.add_geom(
        name="goal",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*region.position, 0.0],
        quat=_yaw_quaternion(region.yaw),
        size=[region.size[0] / 2, region.size[1] / 2, GOAL_SPOT_THICKNESS / 2],
        group=GOAL_GROUP,
        rgba=[*GOAL_COLOUR, 1.0],
        contype=2,  # as the arms' looks in panda.xml: meets nothing, yet has a bounding box for mj_multiRay
        conaffinity=0,
    )


def _yaw_quaternion(yaw: float) -> list[float]:
    return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]
