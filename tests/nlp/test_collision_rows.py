"""The rows of `evaluate` against MuJoCo's scene in the same state: distances by names, switches, footprints."""

from itertools import product

import mujoco
import numpy as np
import pytest
from komo_cases import SCENE, Floats, pose_in_mode
from komo_replay import Replay, arm_pairs, build_replay_model, object_pairs
from scipy.spatial.transform import Rotation

from dvr_jax.nlp.collision_distances import FAR, NEAR
from dvr_jax.nlp.collision_rows import HOLDING_CAPSULES, number_of_rows
from dvr_jax.nlp.problem import FIXED, HELD_LEFT, HELD_RIGHT
from dvr_jax.scene.mjcf import CAPSULE_NAMES, build_home_data, object_body_name, qpos_layout
from dvr_jax.workcell.constants import ARM_NAMES, FINGER_OPEN, JOINT_LOWER, JOINT_UPPER

RELATIVE, ABSOLUTE = 1e-6, 1e-9


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build_replay_model()


def counted(evaluated) -> Floats:
    """(B, T, Po): whether an object row counts, by the rules that `dvr_jax.nlp.collision_distances` documents."""
    case, names = evaluated.case, [object_body_name(item.name) for item in SCENE.objects]
    B, T = case.batch, case.number_of_samples
    counts = np.ones((B, T, len(object_pairs())), bool)
    for b, t in product(range(B), range(T)):
        kind = dict(zip(names, case.problems.attachment[b, case.phase(t)], strict=True))
        for row, (first, second) in enumerate(object_pairs()):
            if second == "top":
                counts[b, t, row] = kind[first] in (HELD_LEFT, HELD_RIGHT)
            elif first in kind:
                counts[b, t, row] = kind[first] != FIXED or kind[second] != FIXED
            else:
                arm, capsule = first.split("/")
                holder = {HELD_LEFT: "left", HELD_RIGHT: "right"}.get(kind[second])
                touching = capsule.removesuffix("_collision") in HOLDING_CAPSULES
                counts[b, t, row] = not (arm == holder and touching)
    return counts


def test_number_of_rows(evaluated) -> None:
    assert evaluated.rows.distance.shape[-1] == len(arm_pairs()) + len(object_pairs()) == number_of_rows(3)


def test_arm_rows(model, evaluated) -> None:
    expected = Replay(model, evaluated.case).measure(arm_pairs())
    ours = evaluated.rows.distance[..., : len(arm_pairs())]
    np.testing.assert_allclose(ours, expected, rtol=RELATIVE, atol=ABSOLUTE)
    assert (expected < 0.1).mean() > 0.02


class ObjectRows:
    """Object rows by MuJoCo and by `evaluate`, where they count."""

    def __init__(self, model: mujoco.MjModel, evaluated) -> None:
        self.expected = Replay(model, evaluated.case).measure(object_pairs())
        self.ours = evaluated.rows.distance[..., len(arm_pairs()) :]
        self.counts = counted(evaluated)
        capsules = {f"{arm}/{name}" for arm in ARM_NAMES for name in CAPSULE_NAMES}
        self.is_capsule = np.array([first in capsules for first, _ in object_pairs()])
        self.is_table = np.array([second == "top" for _, second in object_pairs()])


@pytest.fixture(scope="module")
def object_rows(model) -> dict[int, ObjectRows]:
    return {}


@pytest.fixture
def measured(model, evaluated, object_rows) -> ObjectRows:
    return object_rows.setdefault(evaluated.case.steps, ObjectRows(model, evaluated))


def test_rows_that_do_not_count(evaluated, measured: ObjectRows) -> None:
    """The hand that holds an object, the table under a standing one, two objects where the scene has them."""
    off = ~measured.counts
    assert off.any()
    assert (measured.ours[off] == FAR).all()
    arm = len(arm_pairs())
    J = evaluated.jacobians
    assert J.object_q.shape[-1] + arm == evaluated.rows.distance.shape[-1]
    assert not np.moveaxis(J.object_q, 2, 3)[off].any()
    assert not np.moveaxis(J.object_m, 2, 3)[off].any()


def test_held_objects_and_table(measured: ObjectRows) -> None:
    where = measured.counts & measured.is_table
    assert where.sum() > 10
    np.testing.assert_allclose(measured.ours[where], measured.expected[where], rtol=RELATIVE, atol=ABSOLUTE)


def test_capsules_and_objects(measured: ObjectRows) -> None:
    """Held, placed and standing objects: the distance where it is less than `NEAR`, else a bound between both."""
    where = measured.counts & measured.is_capsule & (measured.expected > 0)
    ours, expected = measured.ours[where], measured.expected[where]
    near = ours < NEAR
    assert near.sum() > 10 and (~near).sum() > 1000
    np.testing.assert_allclose(ours[near], expected[near], rtol=RELATIVE, atol=ABSOLUTE)
    assert (ours <= expected + ABSOLUTE).all()


def test_objects_and_objects(measured: ObjectRows) -> None:
    """Never more than the distance, equal to it in at least half of the rows, and of its sign."""
    where = measured.counts & ~measured.is_capsule & ~measured.is_table
    ours, expected = measured.ours[where], measured.expected[where]
    assert (expected < 0.2).sum() >= 5
    assert (ours <= expected + ABSOLUTE).all()
    assert (np.abs(ours - expected) <= RELATIVE * np.abs(expected)).mean() > 0.5
    assert ((ours > 0) == (expected > 0)).all()


def test_switches(model, evaluated) -> None:
    """Position under the old mode minus that under the new, and the angle between both orientations."""
    replay, case = Replay(model, evaluated.case), evaluated.case
    B, K = case.problems.switched_object.shape
    for b, k in product(range(B), range(K)):
        replay.go(b, (k + 1) * case.steps * case.samples - 1)
        n = case.problems.switched_object[b, k]
        (R_old, p_old), (R_new, p_new) = (pose_in_mode(case, b, phase, n, replay.hands()) for phase in (k, k + 1))
        np.testing.assert_allclose(evaluated.rows.switch[b, k, :3], p_old - p_new, atol=1e-12)
        turn = Rotation.from_matrix(R_old @ R_new.T)
        np.testing.assert_allclose(evaluated.rows.switch_angle[b, k], turn.magnitude(), rtol=1e-9, atol=1e-12)
        if turn.magnitude() < 2.9:
            quaternion = turn.as_quat(canonical=True)
            np.testing.assert_allclose(evaluated.rows.switch[b, k, 3:], 2 * quaternion[:3], rtol=1e-9, atol=1e-12)


def test_footprints(evaluated) -> None:
    """By how much the corners of a box, or points of a circle, stick out of the support, in its own frame."""
    case = evaluated.case
    B, K = case.problems.switched_object.shape
    placed = 0
    for b, k in product(range(B), range(K)):
        ours = evaluated.rows.footprint[b, k]
        if case.problems.is_grasp[b, k]:
            np.testing.assert_array_equal(ours, -1)
            continue
        placed += 1
        x, y, yaw, _ = case.x.m[b, k]
        hx, hy, _, r = case.problems.half[b, case.problems.switched_object[b, k]]
        corners = np.array([[sx * hx, sy * hy] for sx in (-1, 1) for sy in (-1, 1)])
        world = Rotation.from_euler("z", yaw).as_matrix()[:2, :2] @ corners.T + np.array([[x], [y]])
        cx, cy, support_yaw, sx, sy = case.problems.support[b, k]
        local = Rotation.from_euler("z", -support_yaw).as_matrix()[:2, :2] @ (world - np.array([[cx], [cy]]))
        low, high = local.min(1) - r, local.max(1) + r
        expected = [high[0] - sx, high[1] - sy, -sx - low[0], -sy - low[1]]
        np.testing.assert_allclose(ours, expected, atol=1e-12)
    assert placed >= B


@pytest.fixture(scope="module")
def contacts_without_a_row(model) -> dict[frozenset[str], float]:
    """Deepest contact, at random postures, of each pair of capsules or capsule and table that has no row, by MuJoCo."""
    rows = {frozenset(pair) for pair in arm_pairs()}
    rows |= {frozenset((name, "table")) for name, top in arm_pairs() if top == "top"}
    generator, layout = np.random.default_rng(0), qpos_layout(len(SCENE.objects))
    data = build_home_data(model)
    data.qpos[layout.objects[:, 0]] = 50 + np.arange(len(SCENE.objects))
    missing: dict[frozenset[str], float] = {}
    touched = set()
    for index in range(8000):
        angles = generator.uniform(JOINT_LOWER, JOINT_UPPER, (2, 7))
        if index % 2:  # stretched towards each other, else they seldom meet
            angles[:, [0, 1, 3]] = generator.uniform([-0.4, 0.5, -1.5], [0.4, 1.7, -0.1], (2, 3))
        data.qpos[layout.arm_joints] = angles
        data.qpos[layout.fingers] = FINGER_OPEN
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            pair = frozenset(model.geom(g).name for g in contact.geom)
            if contact.dist >= 0 or any(name.startswith("object/") for name in pair):
                continue
            touched.add(pair)
            if pair not in rows:
                missing[pair] = min(missing.get(pair, 0.0), contact.dist)
    if len(touched & rows) < 50:
        raise ValueError(f"only {len(touched & rows)} pairs with a row ever touched")
    return missing


def test_arms_never_touch_in_pairs_without_a_row(contacts_without_a_row) -> None:
    assert not {tuple(pair): depth for pair, depth in contacts_without_a_row.items()}
