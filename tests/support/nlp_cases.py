"""Scenes, skeletons and points for the tests of the NLP, and object poses by the definition of the mode parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from numpy.typing import NDArray
from scene_cases import GOAL, SCENE, grasp, place
from scipy.spatial.transform import Rotation

from dvr_jax.goals import Clear, Goal, On
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.evaluation import Violations, evaluate_constraints
from dvr_jax.nlp.evaluation import violations_of as violations_of_rows
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import measure
from dvr_jax.nlp.system import BorderedSystem
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime.compilation import CPU_OPTIONS
from dvr_jax.scene.types import FixedBody, Region, Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.workcell.model import WorkcellModel, workcell_model
from dvr_jax.workcell.workcell import SIDE_BY_SIDE_WORKCELL, SINGLE_ARM_WORKCELL

Floats = NDArray[np.float64]
Hands = Sequence[tuple[Floats, Floats]]
"""Rotation and position of each gripper."""

SAMPLES = 3
"""Samples of a slice where a test does not say otherwise."""

SKELETONS = (
    # Handover of a box, then its arm is free again while the other one grasps.
    (
        grasp("left", "+x", "yellow"),
        grasp("right", "+y", "yellow"),
        place("right", "yellow", "goal"),
        grasp("left", "-x", "can"),
    ),
    # A cylinder placed and grasped where it was placed.
    (
        grasp("right", "+x", "can"),
        place("right", "can", "table"),
        grasp("left", "-y", "can"),
        place("left", "can", "goal"),
    ),
    # Both arms hold; then a cylinder is handed over.
    (
        grasp("left", "+y", "green"),
        grasp("right", "+x", "can"),
        place("left", "green", "goal"),
        grasp("left", "-x", "can"),
    ),
)

SINGLE_ARM_SKELETONS = (
    (
        grasp("arm", "+x", "yellow"),
        place("arm", "yellow", "goal"),
        grasp("arm", "-y", "can"),
        place("arm", "can", "table"),
    ),
    # A cylinder placed, and grasped where it was placed.
    (
        grasp("arm", "+y", "can"),
        place("arm", "can", "table"),
        grasp("arm", "+x", "can"),
        place("arm", "can", "goal"),
    ),
)


@dataclass(frozen=True)
class Setting:
    """A scene, and skeletons of one length in it."""

    scene: Scene
    skeletons: tuple[tuple[Action, ...], ...]

    @property
    def model(self) -> WorkcellModel:
        return workcell_model(self.scene.workcell)

    @property
    def number_of_fixed(self) -> int:
        return len(self.scene.fixed)


FACING = Setting(SCENE, SKELETONS)
"""The scene of version 0.8's tests."""

FIXED = Setting(
    make_scene(
        SCENE.objects,
        GOAL,
        fixed=[
            # A shelf board above the table, between the hands, and a post beside the right one.
            FixedBody("board", "box", (0.40, 0.24, 0.02), (-0.20, 0.10, 0.50), 0.4),
            FixedBody("post", "cylinder", (0.04, 0.50), (0.40, 0.15, 0.25), 0.0),
        ],
    ),
    SKELETONS,
)
"""The same with fixed bodies of both shapes, one of them high above the table."""

SIDE_BY_SIDE = Setting(replace(SCENE, workcell=SIDE_BY_SIDE_WORKCELL), SKELETONS)
"""The same bodies before arms that stand side by side."""

SINGLE_ARM = Setting(
    make_scene(
        [
            SceneObject("yellow", "box", (0.05, 0.16, 0.10), (-0.15, 0.12), 0.5),
            SceneObject("can", "cylinder", (0.035, 0.14), (0.12, 0.0), 0.0),
        ],
        Goal((On("yellow", "goal"), Clear("spot"))),
        SINGLE_ARM_WORKCELL,
        [FixedBody("screen", "box", (0.5, 0.04, 0.4), (0.0, 0.04, 0.46), 0.1)],
        [
            Region((0.25, 0.2), 0.4, (0.22, 0.2)),
            Region((-0.2, 0.3), 0.2, (0.3, 0.15), "spot"),
        ],
    ),
    SINGLE_ARM_SKELETONS,
)
"""One arm, a box, a cylinder, a screen that hangs before it, and a region that has to be clear."""


@dataclass(frozen=True)
class Case:
    """B problems with as many points."""

    setting: Setting
    problems: Problem
    x: Variables
    steps: int
    """Slices of a phase."""

    @property
    def batch(self) -> int:
        return len(self.problems.prism)

    @property
    def samples(self) -> int:
        """Samples of a slice at which distances are taken."""
        return self.problems.sample_fraction.shape[2]

    @property
    def number_of_samples(self) -> int:
        """T' of the whole motion."""
        return self.x.q.shape[1] * self.samples

    @property
    def number_of_objects(self) -> int:
        return self.problems.prism.shape[1]

    def phase(self, sample: int) -> int:
        return sample // (self.steps * self.samples)

    def fraction(self, b: int, sample: int) -> float:
        """How far a sample is from the slice before (0) to its own (1)."""
        return float(
            self.problems.sample_fraction[b, sample // self.samples, sample % self.samples]
        )

    def posture(self, b: int, sample: int) -> Floats:
        """Joint angles (D,) beside the straight line from the slice before, the first of which is home."""
        knots = np.concatenate([self.problems.home[b][None], self.x.q[b]])
        t, fraction = sample // self.samples, self.fraction(b, sample)
        line = (1 - fraction) * knots[t] + fraction * knots[t + 1]
        return line + self.problems.sample_offset[b, t, sample % self.samples]


def stack(problems: Sequence[Problem]) -> Problem:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *problems)


def make_case(
    steps: int,
    repeats: int,
    seed: int,
    level: bool = False,
    samples: int = SAMPLES,
    setting: Setting = FACING,
) -> Case:
    """All skeletons, each at ``repeats`` random points: joints near home, parameters within bounds or on the table.

    ``samples``: of each slice of a path.

    ``level``: the hands turn about their vertical axes and hardly tilt, with the standing objects below them, so that
    faces of held and of standing objects face each other.
    """
    problems = stack(
        [transcribe(setting.scene, skeleton) for skeleton in setting.skeletons] * repeats
    )
    generator = np.random.default_rng(seed)
    B, K = problems.switched_object.shape
    arms = setting.scene.workcell.number_of_arms
    D = setting.scene.workcell.number_of_joints
    if level:
        below = np.array([[-0.4, 0.0], [0.4, 0.0], [-0.4, 0.0]])
        problems.initial_pose[..., :2] = below + generator.normal(size=(B, 3, 2)) * 0.05

    limits = np.tile(setting.model.joint_limits, arms)
    noise = np.tile([0.6, 0.03, 0.03, 0.03, 0.03, 0.03, 0.6], arms) if level else 0.25
    q = problems.home[:, None] + generator.normal(size=(B, K * steps, D)) * noise
    q = np.clip(q, limits[0], limits[1])

    bounded = problems.parameter_upper < 100
    lower = np.where(bounded, problems.parameter_lower, [-0.4, -0.4, -2.0, -2.0])
    upper = np.where(bounded, problems.parameter_upper, [0.4, 0.4, 2.0, 2.0])
    # Approaches up to 1 rad from straight down.
    tilt = 0.03 if level else 1.0
    grasping = problems.on_support[..., None] == 0
    pitch = np.arange(4) == 2
    lower, upper = (np.where(grasping & pitch, np.clip(v, -tilt, tilt), v) for v in (lower, upper))
    x = Variables(q, generator.uniform(lower, upper))

    # A pull of its own to a posture of its own in every slice and joint, so that none can be taken for another.
    problems = problems._replace(
        regularization_target=problems.home[:, None] + generator.normal(size=q.shape) * 0.2,
        regularization_weight=generator.uniform(0.1, 0.5, q.shape),
        preference_scale=np.ones_like(problems.preference_scale),
        # A clearance of its own for every row of every slice.
        clearance=generator.uniform(0.0, 0.01, (B, K * steps, problems.clearance.shape[-1])),
    )
    if steps > 1:
        # Samples anywhere in the interval, and beside the line; the last one at the slice.
        between = np.sort(generator.uniform(0, 1, (*q.shape[:2], samples - 1)), axis=-1)
        offset = generator.normal(size=(*between.shape, q.shape[2])) * (0.003 if level else 0.03)
        problems = problems._replace(
            sample_fraction=np.concatenate([between, np.ones((*q.shape[:2], 1))], axis=-1),
            sample_offset=np.concatenate([offset, np.zeros((*q.shape[:2], 1, q.shape[2]))], axis=2),
        )
    return Case(setting, problems, x, steps)


def pose_in_mode(case: Case, b: int, phase: int, n: int, hands: Hands) -> tuple[Floats, Floats]:
    """World pose of object n of problem b as it is attached in a phase, given all grippers' poses."""
    kind = case.problems.mode_kind[b, phase, n]
    by = case.problems.mode_action[b, phase, n]
    m = np.asarray(case.x.m[b, by])
    if kind == ModeKind.FIXED:
        x, y, z, yaw = case.problems.initial_pose[b, n]
        return Rotation.from_euler("z", yaw).as_matrix(), np.array([x, y, z])
    if kind == ModeKind.PLACED:
        return Rotation.from_euler("z", m[2]).as_matrix(), np.array(
            [m[0], m[1], m[3] + case.problems.prism[b, n, 2]]
        )
    assert kind == ModeKind.HELD
    # In the object's frame, at yaw 0 and pitch 0, the gripper points straight down (its z) and closes along +x (its y).
    face = Rotation.from_euler("z", case.problems.closing_yaw[b, by] + m[3])
    down = Rotation.from_matrix(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))
    # Pitch turns the approach about the closing axis, toward the tangent z x n.
    T_object_hand_R = (face * Rotation.from_euler("x", m[2]) * down).as_matrix()
    T_object_hand_p = face.apply([0, m[0], m[1]])
    R_hand, p_hand = hands[case.problems.mode_parent[b, phase, n]]
    R = R_hand @ T_object_hand_R.T
    return R, p_hand - R @ T_object_hand_p


def written_out(system: BorderedSystem) -> np.ndarray:
    """A system's matrix as `dvr_jax.nlp.system` describes it, block by block, lower triangle first."""
    T, D, M = system.border.shape
    H = np.zeros((T * D + M, T * D + M))
    H[T * D :, T * D :] = system.corner
    for t in range(T):
        rows = slice(t * D, (t + 1) * D)
        H[rows, rows] = system.diagonal[t]
        H[T * D :, rows] = np.transpose(system.border[t])
        if system.coupling is not None and t >= 1:
            H[rows, (t - 1) * D : t * D] = system.coupling[t]
        if system.far_coupling is not None and t >= 2:
            H[rows, (t - 2) * D : (t - 1) * D] = np.diag(system.far_coupling[t])
    return np.tril(H) + np.tril(H, -1).T


def _violations_of(model: WorkcellModel, problems: Problem, x: Variables) -> Violations:
    geometry = measure(model, lay_out(problems, x))
    return violations_of_rows(evaluate_constraints(model, problems, x, geometry))


violations_of = jax.jit(_violations_of, compiler_options=CPU_OPTIONS)
"""Violations of a batch of points, whatever a solver says of them."""
