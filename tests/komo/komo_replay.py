"""A case's slices as states of the scene's MuJoCo model, and the names of the distance rows."""

from itertools import combinations, product

import mujoco
import numpy as np
from dvr_jax.workcell.constants import ARM_NAMES
from komo_cases import SCENE, Case, Floats, pose_in_mode
from scipy.spatial.transform import Rotation

from dvr_jax.nlp.collision_rows import ABOVE_TABLE, CROSS_PAIRS, SELF_PAIRS
from dvr_jax.scene.mjcf import CAPSULE_NAMES, build_home_data, build_model_spec, object_body_name, qpos_layout

Names = tuple[str, str]


def arm_pairs() -> list[Names]:
    """Geom names of the arm rows, in order."""
    left, right = ([f"{arm}/{name}" for name in CAPSULE_NAMES] for arm in ARM_NAMES)
    pairs = [pair for first, second in CROSS_PAIRS for pair in product(left[first], right[second])]
    pairs += [pair for near, far in SELF_PAIRS for arm in (left, right) for pair in product(arm[near], arm[far])]
    return pairs + [(name, "top") for arm in (left, right) for name in arm[ABOVE_TABLE]]


def object_pairs() -> list[Names]:
    """Geom names of the object rows, in order."""
    objects = [object_body_name(item.name) for item in SCENE.objects]
    capsules = [f"{arm}/{name}" for arm in ARM_NAMES for name in CAPSULE_NAMES]
    pairs = [(capsule, item) for item in objects for capsule in capsules]
    return pairs + [(item, "top") for item in objects] + list(combinations(objects, 2))


def build_replay_model() -> mujoco.MjModel:
    """The scene with an endless plane at the table's height: arms may reach beyond the table."""
    spec = build_model_spec(SCENE)
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-12, 500
    spec.worldbody.add_geom(name="top", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], contype=0, conaffinity=0)
    return spec.compile()


class Replay:
    """A case's slices as states of the MuJoCo model."""

    def __init__(self, model: mujoco.MjModel, case: Case) -> None:
        self.model, self.case = model, case
        self.data, self.layout = build_home_data(model), qpos_layout(len(SCENE.objects))
        self.geom = {model.geom(i).name: i for i in range(model.ngeom)}

    def hands(self) -> list[tuple[Floats, Floats]]:
        sites = [self.data.site(f"{arm}/gripper") for arm in ARM_NAMES]
        return [(site.xmat.reshape(3, 3).copy(), site.xpos.copy()) for site in sites]

    def openings(self, b: int, t: int) -> Floats:
        """Of a phase; in the slice of its switch the wider of before and after, as `dvr_jax.nlp.constraints` has
        it."""
        before, after = self.case.problems.opening[b, self.case.phase(t) : self.case.phase(t) + 2]
        switching = (t // self.case.samples + 1) % self.case.steps == 0
        return np.maximum(before, after) if switching else before

    def go(self, b: int, t: int) -> None:
        case, qpos = self.case, self.data.qpos
        qpos[self.layout.arm_joints] = case.posture(b, t).reshape(2, 7)
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
        value = mujoco.mj_geomDistance(self.model, self.data, self.geom[pair[0]], self.geom[pair[1]], 10.0, witness)
        return value, witness[:3] - witness[3:]

    def measure(self, pairs: list[Names]) -> Floats:
        """(B, T, P)."""
        B, T = self.case.batch, self.case.number_of_samples
        values = np.zeros((B, T, len(pairs)))
        for b, t in product(range(B), range(T)):
            self.go(b, t)
            values[b, t] = [self.distance(pair)[0] for pair in pairs]
        return values

    def faces(self, pairs: list[Names]) -> Floats:
        """(B, T, P): True where a flat face of either body is nearest."""
        B, T = self.case.batch, self.case.number_of_samples
        nearest = np.zeros((B, T, len(pairs)), bool)
        for b, t in product(range(B), range(T)):
            self.go(b, t)
            for row, pair in enumerate(pairs):
                normal = self.distance(pair)[1]
                for name in pair:
                    along = np.abs(normal @ self.data.geom(name).xmat.reshape(3, 3)) / np.linalg.norm(normal)
                    box = self.model.geom(name).type == mujoco.mjtGeom.mjGEOM_BOX
                    nearest[b, t, row] |= (along.max() if box else along[2]) > 1 - 1e-9
        return nearest
