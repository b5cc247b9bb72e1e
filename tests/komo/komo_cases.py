"""Scene, skeletons and points for the tests of the NLP, and object poses from the definition of the mode parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from dvr_jax.nlp.constraints import collect, lay_out
from dvr_jax.nlp.tolerances import Violations, measure_violations
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import FIXED, PLACED, Problem, Variables
from dvr_jax.nlp.slices import measure
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.scene.files import Goal, Region, SceneObject, make_scene
from dvr_jax.solver.banded import BorderedSystem
from dvr_jax.solver.continuous_collision import PATH_SAMPLES
from dvr_jax.workcell.kinematics import load_arm

Floats = NDArray[np.float64]
Hands = Sequence[tuple[Floats, Floats]]
"""Rotation and position of the left and the right gripper."""

SCENE = make_scene(
    [
        SceneObject("yellow", "box", (0.05, 0.16, 0.10), (-0.15, 0.22), 0.5),
        SceneObject("can", "cylinder", (0.035, 0.14), (0.12, -0.2), 0.0),
        SceneObject("green", "box", (0.06, 0.06, 0.18), (0.05, 0.3), 0.3),
    ],
    Goal("yellow", Region((0.3, -0.25), 0.4, (0.22, 0.2))),
)


def grasp(arm: str, face: str, item: str) -> Action:
    return Action("grasp", (arm, face, item))


def place(arm: str, item: str, support: str) -> Action:
    return Action("place", (arm, item, support))


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


@dataclass(frozen=True)
class Case:
    """B problems with as many points."""

    problems: Problem
    x: Variables
    steps: int
    """Slices of a phase."""

    @property
    def batch(self) -> int:
        return len(self.problems.half)

    @property
    def samples(self) -> int:
        """Samples of a slice at which distances are taken."""
        return self.problems.share.shape[2]

    @property
    def number_of_samples(self) -> int:
        """T' of the whole motion."""
        return self.x.q.shape[1] * self.samples

    def phase(self, sample: int) -> int:
        return sample // (self.steps * self.samples)

    def share(self, b: int, sample: int) -> float:
        """How far a sample is from the slice before (0) to its own (1)."""
        return float(self.problems.share[b, sample // self.samples, sample % self.samples])

    def posture(self, b: int, sample: int) -> Floats:
        """Joint angles (14,) beside the straight line from the slice before, the first of which is home."""
        knots = np.concatenate([self.problems.home[b][None], self.x.q[b]])
        t, share = sample // self.samples, self.share(b, sample)
        line = (1 - share) * knots[t] + share * knots[t + 1]
        return line + self.problems.offset[b, t, sample % self.samples]


def stack(problems: Sequence[Problem]) -> Problem:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *problems)


def make_case(steps: int, repeats: int, seed: int, level: bool = False, samples: int = PATH_SAMPLES) -> Case:
    """All skeletons, each at ``repeats`` random points: joints near home, parameters within bounds or on the table.

    ``samples``: of each slice of a path.

    ``level``: the hands turn about their vertical axes and hardly tilt, with the standing objects below them, so that
    faces of held and of standing objects face each other.
    """
    problems = stack([transcribe(SCENE, skeleton) for skeleton in SKELETONS] * repeats)
    generator = np.random.default_rng(seed)
    B, K = problems.switched_object.shape
    if level:
        below = np.array([[-0.4, 0.0], [0.4, 0.0], [-0.4, 0.0]])
        problems.initial_pose[..., :2] = below + generator.normal(size=(B, 3, 2)) * 0.05
    limits = np.tile(load_arm().joint_limits, 2)
    noise = np.tile([0.6, 0.03, 0.03, 0.03, 0.03, 0.03, 0.6], 2) if level else 0.25
    q = problems.home[:, None] + generator.normal(size=(B, K * steps, 14)) * noise
    q = np.clip(q, limits[0], limits[1])
    bounded = problems.upper < 100
    lower = np.where(bounded, problems.lower, [-0.4, -0.4, -2.0, -2.0])
    upper = np.where(bounded, problems.upper, [0.4, 0.4, 2.0, 2.0])
    # Approaches up to 1 rad from straight down.
    tilt = 0.03 if level else 1.0
    grasping = problems.is_grasp[..., None] > 0
    pitch = np.arange(4) == 2
    lower, upper = (np.where(grasping & pitch, np.clip(v, -tilt, tilt), v) for v in (lower, upper))
    x = Variables(q, generator.uniform(lower, upper))
    # A pull of its own to a posture of its own in every slice and joint, so that none can be taken for another.
    reference = problems.home[:, None] + generator.normal(size=q.shape) * 0.2
    problems = problems._replace(reference=reference, attraction=generator.uniform(0.1, 0.5, q.shape))
    if steps > 1:
        # Samples anywhere in the interval, and beside the line; the last one at the slice.
        between = np.sort(generator.uniform(0, 1, (*q.shape[:2], samples - 1)), axis=-1)
        offset = generator.normal(size=(*between.shape, q.shape[2])) * (0.003 if level else 0.03)
        problems = problems._replace(
            share=np.concatenate([between, np.ones((*q.shape[:2], 1))], axis=-1),
            offset=np.concatenate([offset, np.zeros((*q.shape[:2], 1, q.shape[2]))], axis=2),
        )
    return Case(problems, x, steps)


def pose_in_mode(case: Case, b: int, phase: int, n: int, hands: Hands) -> tuple[Floats, Floats]:
    """World pose of object n of problem b as it is attached in a phase, given both grippers' poses."""
    kind = case.problems.attachment[b, phase, n]
    by = case.problems.attached_by[b, phase, n]
    m = np.asarray(case.x.m[b, by])
    if kind == FIXED:
        x, y, z, yaw = case.problems.initial_pose[b, n]
        return Rotation.from_euler("z", yaw).as_matrix(), np.array([x, y, z])
    if kind == PLACED:
        return Rotation.from_euler("z", m[2]).as_matrix(), np.array([m[0], m[1], case.problems.half[b, n, 2]])
    # In the object's frame, at yaw 0 and pitch 0, the gripper points straight down (its z) and closes along +x (its y).
    face = Rotation.from_euler("z", case.problems.face_yaw[b, by] + m[3])
    down = Rotation.from_matrix(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))
    # Pitch turns the approach about the closing axis, toward the tangent z x n.
    T_object_hand_R = (face * Rotation.from_euler("x", m[2]) * down).as_matrix()
    T_object_hand_p = face.apply([0, m[0], m[1]])
    R_hand, p_hand = hands[kind - 2]
    R = R_hand @ T_object_hand_R.T
    return R, p_hand - R @ T_object_hand_p


def written_out(system: BorderedSystem) -> np.ndarray:
    """A system's matrix as `dvr_jax.solver.banded` describes it, block by block, lower triangle first."""
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


@jax.jit
def violations_of(problems: Problem, x: Variables) -> Violations:
    """Of points, whatever a solver says of them."""
    measured = measure(lay_out(problems, x))
    rows, _ = collect(problems, x, measured.distance, measured.hand_R, measured.hand_p, measured.screws)
    return jax.vmap(measure_violations)(problems, x, rows)
