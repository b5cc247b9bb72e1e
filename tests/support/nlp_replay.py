"""A case's slices as states of its scene's MuJoCo model, and the names of the distance rows."""

from itertools import combinations, product

import mujoco
import numpy as np
from nlp_cases import Case, Floats, pose_in_mode
from scipy.spatial.transform import Rotation

from dvr_jax.scene.mjcf import (
    build_home_data,
    build_model_spec,
    fixed_body_name,
    object_body_name,
    qpos_layout,
)
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.workcell import Workcell, cross_arm_pairs

Names = tuple[str, str]


def capsule_names(workcell: Workcell) -> list[list[str]]:
    """Geom names of the capsules of each arm."""
    return [
        [f"{arm}/{name}_collision" for name in workcell.robot.capsules.names]
        for arm in workcell.arm_names
    ]


def arm_pairs(workcell: Workcell) -> list[Names]:
    """Geom names of the arm rows, in order."""
    arms = capsule_names(workcell)
    robot = workcell.robot
    pairs: list[Names] = []
    for first, second, (near, far) in cross_arm_pairs(workcell):
        pairs += product(arms[first][slice(*near)], arms[second][slice(*far)])
    for near, far in robot.self_collision_pairs:
        for arm in arms:
            pairs += product(arm[slice(*near)], arm[slice(*far)])
    return pairs + [(name, "top") for arm in arms for name in arm[slice(*robot.table_capsules)]]


def body_pairs(scene: Scene) -> list[Names]:
    """Geom names of the body rows, in order."""
    objects = [object_body_name(item.name) for item in scene.objects]
    fixed = [fixed_body_name(body.name) for body in scene.fixed]
    capsules = [name for arm in capsule_names(scene.workcell) for name in arm]
    pairs: list[Names] = [(capsule, body) for body in objects + fixed for capsule in capsules]
    pairs += [(item, "top") for item in objects]
    return pairs + list(combinations(objects, 2)) + list(product(objects, fixed))


def clearances(case: Case) -> Floats:
    """(B, T', P): the clearance of each row by the definition of `dvr_jax.workcell.clearances`, and as the case has
    it."""
    workcell = case.setting.scene.workcell
    robot = workcell.robot
    keep = workcell.clearances
    holding = {robot.capsules.names[c] for c in robot.holding_capsules}
    objects = [object_body_name(item.name) for item in case.setting.scene.objects]
    A, N = workcell.number_of_arms, len(objects)
    pairs = arm_pairs(workcell) + body_pairs(case.setting.scene)
    of_bodies = iter(range(A * N + N, case.problems.clearance.shape[-1]))

    values = np.zeros((case.batch, case.number_of_samples, len(pairs)))
    own = np.repeat(case.problems.clearance, case.samples, axis=1)
    for row, (first, second) in enumerate(pairs):
        arm, _, capsule = first.partition("/")
        is_hand = capsule.removesuffix("_collision") in holding
        if first in objects:
            column = A * N + objects.index(first) if second == "top" else next(of_bodies)
            values[..., row] = own[..., column]
        elif second == "top":
            values[..., row] = keep.hand_to_table if is_hand else keep.link_to_table
        elif second in objects and is_hand:
            column = workcell.arm_names.index(arm) * N + objects.index(second)
            values[..., row] = own[..., column]
        elif second.startswith(("object/", "fixed/")):
            values[..., row] = keep.hand_to_object if is_hand else keep.link_to_object
        else:
            values[..., row] = keep.arm_to_arm if second.partition("/")[0] != arm else 0.0
    return values


def build_replay_model(scene: Scene) -> mujoco.MjModel:
    """The scene with an endless plane at the table's height: arms may reach beyond the table."""
    spec = build_model_spec(scene)
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-12, 500
    spec.worldbody.add_geom(
        name="top", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], contype=0, conaffinity=0
    )
    return spec.compile()


class Replay:
    """A case's slices as states of the MuJoCo model."""

    def __init__(self, model: mujoco.MjModel, case: Case) -> None:
        self.model, self.case = model, case
        self.scene = case.setting.scene
        self.data, self.layout = build_home_data(model), qpos_layout(self.scene)
        self.geom = {model.geom(i).name: i for i in range(model.ngeom)}

    def hands(self) -> list[tuple[Floats, Floats]]:
        sites = [self.data.site(f"{arm}/gripper") for arm in self.scene.workcell.arm_names]
        return [(site.xmat.reshape(3, 3).copy(), site.xpos.copy()) for site in sites]

    def openings(self, b: int, t: int) -> Floats:
        """Of a phase; in the slice of its switch the wider of before and after, as `dvr_jax.nlp.layout` has it."""
        before, after = self.case.problems.finger_opening[
            b, self.case.phase(t) : self.case.phase(t) + 2
        ]
        switching = (t // self.case.samples + 1) % self.case.steps == 0
        return np.maximum(before, after) if switching else before

    def go(self, b: int, t: int) -> None:
        case, qpos = self.case, self.data.qpos
        qpos[self.layout.arm_joints] = case.posture(b, t).reshape(self.layout.arm_joints.shape)
        qpos[self.layout.fingers] = self.openings(b, t)[:, None]
        mujoco.mj_kinematics(self.model, self.data)
        hands = self.hands()
        for n, indices in enumerate(self.layout.objects):
            R, p = pose_in_mode(case, b, case.phase(t), n, hands)
            qpos[indices] = [*p, *Rotation.from_matrix(R).as_quat(scalar_first=True)]
        mujoco.mj_kinematics(self.model, self.data)

    def distance(self, pair: Names) -> tuple[float, Floats]:
        """`mj_geomDistance` and the direction between the nearest points."""
        witness = np.zeros(6)
        value = mujoco.mj_geomDistance(
            self.model, self.data, self.geom[pair[0]], self.geom[pair[1]], 10.0, witness
        )
        return value, witness[:3] - witness[3:]

    def measure(self, pairs: list[Names]) -> Floats:
        """(B, T', P)."""
        B, T = self.case.batch, self.case.number_of_samples
        values = np.zeros((B, T, len(pairs)))
        for b, t in product(range(B), range(T)):
            self.go(b, t)
            values[b, t] = [self.distance(pair)[0] for pair in pairs]
        return values

    def faces(self, pairs: list[Names]) -> Floats:
        """(B, T', P): True where a flat face of either body is nearest."""
        B, T = self.case.batch, self.case.number_of_samples
        nearest = np.zeros((B, T, len(pairs)), bool)
        for b, t in product(range(B), range(T)):
            self.go(b, t)
            for row, pair in enumerate(pairs):
                normal = self.distance(pair)[1]
                for name in pair:
                    along = np.abs(
                        normal @ self.data.geom(name).xmat.reshape(3, 3)
                    ) / np.linalg.norm(normal)
                    box = self.model.geom(name).type == mujoco.mjtGeom.mjGEOM_BOX
                    nearest[b, t, row] |= (along.max() if box else along[2]) > 1 - 1e-9
        return nearest
