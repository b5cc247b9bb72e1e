"""The rows of the NLP against MuJoCo's scene in the same state: distances by names, switches, footprints."""

from itertools import product

import mujoco
import numpy as np
import pytest
from nlp_cases import Floats, pose_in_mode
from nlp_replay import (
    Replay,
    arm_pairs,
    body_pairs,
    build_replay_model,
    capsule_names,
    clearances,
)
from scipy.spatial.transform import Rotation

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.collision_distances import FAR, NEAR
from dvr_jax.nlp.collision_rows import number_of_rows
from dvr_jax.scene.mjcf import build_home_data, fixed_body_name, object_body_name, qpos_layout
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.workcell import WORKCELLS, Workcell, facing_workcell

RELATIVE, ABSOLUTE = 1e-6, 1e-9


@pytest.fixture(scope="session")
def replay(evaluated) -> Replay:
    return Replay(build_replay_model(evaluated.case.setting.scene), evaluated.case)


def counted(evaluated) -> Floats:
    """(B, T', Po): whether a body row counts, by the rules that `dvr_jax.nlp.collision_distances` documents."""
    case = evaluated.case
    scene = case.setting.scene
    pairs = body_pairs(scene)
    objects = [object_body_name(item.name) for item in scene.objects]
    fixed = dict.fromkeys((fixed_body_name(body.name) for body in scene.fixed), ModeKind.FIXED)
    holding = [
        scene.workcell.robot.capsules.names[c] for c in scene.workcell.robot.holding_capsules
    ]
    B, T = case.batch, case.number_of_samples
    counts = np.ones((B, T, len(pairs)), bool)
    for b, t in product(range(B), range(T)):
        kind = dict(zip(objects, case.problems.mode_kind[b, case.phase(t)], strict=True)) | fixed
        parent = dict(zip(objects, case.problems.mode_parent[b, case.phase(t)], strict=True))
        for row, (first, second) in enumerate(pairs):
            if second == "top":
                counts[b, t, row] = kind[first] == ModeKind.HELD
            elif first.endswith("/base_collision") and kind[second] == ModeKind.FIXED:
                counts[b, t, row] = False
            elif first in kind:
                counts[b, t, row] = kind[first] != ModeKind.FIXED or kind[second] != ModeKind.FIXED
            elif kind[second] == ModeKind.HELD:
                arm, capsule = first.split("/")
                holder = scene.workcell.arm_names[parent[second]]
                counts[b, t, row] = not (
                    arm == holder and capsule.removesuffix("_collision") in holding
                )
    return counts


def test_number_of_rows(evaluated) -> None:
    scene = evaluated.case.setting.scene
    expected = len(arm_pairs(scene.workcell)) + len(body_pairs(scene))
    assert evaluated.arm_rows == len(arm_pairs(scene.workcell))
    assert evaluated.distance.shape[-1] == expected
    assert (
        number_of_rows(evaluated.model.structure, len(scene.objects), len(scene.fixed)) == expected
    )


def test_arm_rows(replay: Replay, evaluated) -> None:
    keep = clearances(evaluated.case)[..., : evaluated.arm_rows]
    expected = replay.measure(arm_pairs(evaluated.case.setting.scene.workcell)) - keep
    ours = evaluated.distance[..., : evaluated.arm_rows]
    np.testing.assert_allclose(ours, expected, rtol=RELATIVE, atol=ABSOLUTE)
    assert (expected < 0.1).mean() > 0.01


class BodyRows:
    """Body rows by MuJoCo and by ourselves, where they count."""

    def __init__(self, replay: Replay, evaluated) -> None:
        scene = evaluated.case.setting.scene
        self.pairs = body_pairs(scene)
        keep = clearances(evaluated.case)[..., evaluated.arm_rows :]
        self.expected = replay.measure(self.pairs) - keep
        self.ours = evaluated.distance[..., evaluated.arm_rows :]
        self.counts = counted(evaluated)
        capsules = {name for arm in capsule_names(scene.workcell) for name in arm}
        self.is_capsule = np.array([first in capsules for first, _ in self.pairs])
        self.is_table = np.array([second == "top" for _, second in self.pairs])
        self.is_fixed = np.array([second.startswith("fixed/") for _, second in self.pairs])


@pytest.fixture(scope="session")
def measured(replay: Replay, evaluated) -> BodyRows:
    return BodyRows(replay, evaluated)


def test_rows_that_do_not_count(evaluated, measured: BodyRows) -> None:
    """The hand that holds an object, the table under a standing one, two bodies where the scene has them."""
    off = ~measured.counts
    assert off.any()
    assert (measured.ours[off] == FAR).all()
    J = evaluated.results.distance_jacobian
    assert J.shape[-1] == evaluated.distance.shape[-1]
    assert not np.moveaxis(J[..., evaluated.arm_rows :], 2, 3)[off].any()


def test_held_objects_and_table(measured: BodyRows) -> None:
    where = measured.counts & measured.is_table
    assert where.sum() > 10
    np.testing.assert_allclose(
        measured.ours[where], measured.expected[where], rtol=RELATIVE, atol=ABSOLUTE
    )


def compare_capsules(measured: BodyRows, of_fixed: bool) -> tuple[int, int]:
    """Compare rows of capsules; returns how many of them are near, and how many far."""
    where = (
        measured.counts
        & measured.is_capsule
        & (measured.expected > 0)
        & (measured.is_fixed == of_fixed)
    )
    ours, expected = measured.ours[where], measured.expected[where]
    near = ours < NEAR
    np.testing.assert_allclose(ours[near], expected[near], rtol=RELATIVE, atol=ABSOLUTE)
    assert (ours <= expected + ABSOLUTE).all()
    return int(near.sum()), int((~near).sum())


def test_capsules_and_objects(measured: BodyRows) -> None:
    """Held, placed and standing objects: the distance where it is less than `NEAR`, else a bound between both."""
    near, far = compare_capsules(measured, of_fixed=False)
    assert near > 10 and far > 1000


def test_capsules_and_fixed_bodies(measured: BodyRows) -> None:
    if not measured.is_fixed.any():
        pytest.skip("no fixed bodies")
    near, far = compare_capsules(measured, of_fixed=True)
    assert near > 10 and far > 500


def compare_bodies(measured: BodyRows, of_fixed: bool) -> Floats:
    """Never more than the distance, and of its sign; returns which of the rows are equal to it."""
    where = (
        measured.counts
        & ~measured.is_capsule
        & ~measured.is_table
        & (measured.is_fixed == of_fixed)
    )
    ours, expected = measured.ours[where], measured.expected[where]
    assert (expected < 0.2).sum() >= 5
    assert (ours <= expected + ABSOLUTE).all()
    assert ((ours > 0) == (expected > 0)).all()
    return np.abs(ours - expected) <= RELATIVE * np.abs(expected)


def test_objects_and_objects(evaluated, measured: BodyRows) -> None:
    """Equal to the distance in at least half of the rows, or a third of those of a box and a cylinder; past corners a
    bound (tests/geometry)."""
    has_one_pair = evaluated.case.number_of_objects == 2
    assert compare_bodies(measured, of_fixed=False).mean() > (0.3 if has_one_pair else 0.5)


def test_objects_and_fixed_bodies(measured: BodyRows) -> None:
    if not measured.is_fixed.any():
        pytest.skip("no fixed bodies")
    assert compare_bodies(measured, of_fixed=True).mean() > 0.4


def test_switches(replay: Replay, evaluated) -> None:
    """Position under the old mode minus that under the new, and the angle between both orientations."""
    case = evaluated.case
    rows = evaluated.results.rows["mode_switch"]
    B, K = case.problems.switched_object.shape
    distances, angles = np.zeros((2, B, K))
    for b, k in product(range(B), range(K)):
        replay.go(b, evaluated.switch_sample(k))
        n = case.problems.switched_object[b, k]
        (R_old, p_old), (R_new, p_new) = (
            pose_in_mode(case, b, phase, n, replay.hands()) for phase in (k, k + 1)
        )
        np.testing.assert_allclose(rows[b, k, :3], p_old - p_new, atol=1e-12)
        distances[b, k] = np.linalg.norm(p_old - p_new)
        turn = Rotation.from_matrix(R_old @ R_new.T)
        angles[b, k] = turn.magnitude()
        if turn.magnitude() < 2.9:
            quaternion = turn.as_quat(canonical=True)
            np.testing.assert_allclose(rows[b, k, 3:], 2 * quaternion[:3], rtol=1e-9, atol=1e-12)
    position, rotation = evaluated.results.violations["mode_switch"]
    np.testing.assert_allclose(position, distances.max(1), rtol=1e-12)
    np.testing.assert_allclose(rotation, angles.max(1), rtol=1e-9)


def test_footprints(evaluated) -> None:
    """By how much the corners of a box, or points of a circle, stick out of the support, in its own frame."""
    case = evaluated.case
    rows = evaluated.results.rows["footprint"]
    B, K = case.problems.switched_object.shape
    placed = 0
    for b, k in product(range(B), range(K)):
        if not case.problems.on_support[b, k]:
            np.testing.assert_array_equal(rows[b, k], -1)
            continue
        placed += 1
        x, y, yaw, _ = case.x.m[b, k]
        hx, hy, _, r = case.problems.prism[b, case.problems.switched_object[b, k]]
        corners = np.array([[sx * hx, sy * hy] for sx in (-1, 1) for sy in (-1, 1)])
        world = Rotation.from_euler("z", yaw).as_matrix()[:2, :2] @ corners.T + np.array([[x], [y]])
        cx, cy, support_yaw, sx, sy = case.problems.support[b, k]
        local = Rotation.from_euler("z", -support_yaw).as_matrix()[:2, :2] @ (
            world - np.array([[cx], [cy]])
        )
        low, high = local.min(1) - r, local.max(1) + r
        expected = [high[0] - sx, high[1] - sy, -sx - low[0], -sy - low[1]]
        sides = np.reshape(rows[b, k], (4, 4)).max(axis=1)
        np.testing.assert_allclose(sides, expected, atol=1e-12)

    # An object that goes onto another one has no rows of this block, but those of the block of stacks.
    on_top = np.any(np.asarray(case.problems.top_half) > 0, axis=(2, 3)).sum()
    assert placed + on_top >= B


CLOSE = facing_workcell(0.6)
"""Arms that stand closer than in any workcell that has a name: far more pairs of their capsules can meet."""


def stretched(workcell: Workcell, generator: np.random.Generator) -> Floats:
    """Postures of arms that reach for the middle of all bases, or ahead where there is one; else they seldom meet."""
    middle = np.mean([arm.position for arm in workcell.arms], axis=0)
    angles = generator.uniform(*workcell.robot.joint_limits, (workcell.number_of_arms, 7))
    for index, arm in enumerate(workcell.arms):
        away = middle - arm.position
        straight = np.arctan2(away[1], away[0]) - arm.yaw if away.any() else 0.0
        low, high = np.array([[straight - 0.4, 0.5, -1.5], [straight + 0.4, 1.7, -0.1]])
        angles[index, [0, 1, 3]] = generator.uniform(low, high)
    angles[:, 0] = np.remainder(angles[:, 0] + np.pi, 2 * np.pi) - np.pi
    return np.clip(angles, *workcell.robot.joint_limits)


TOUCHING = {
    "facing": 65,
    "facing-1.0": 90,
    "facing-1.6": 60,
    "facing-0.6": 100,
    "side-by-side": 95,
    "single": 18,
}
"""How many rows touch at least at the sampled postures; there are 98, 123, 98, 128, 125 and 25."""


@pytest.mark.parametrize("name", [*WORKCELLS, "facing-0.6"])
def test_arms_never_touch_in_pairs_without_a_row(name: str) -> None:
    """Capsules, and capsules and the table, at random postures, by MuJoCo."""
    workcell = WORKCELLS.get(name, CLOSE)
    item = SceneObject("box", "box", (0.05, 0.05, 0.05), (0.0, 0.6), 0.0)
    scene = Scene((item,), OnRegion("box", Region((0, 0), 0, (0.2, 0.2))), workcell)
    model = build_replay_model(scene)
    rows = {
        frozenset((first, second.replace("top", "table"))) for first, second in arm_pairs(workcell)
    }

    generator, layout = np.random.default_rng(0), qpos_layout(scene)
    data = build_home_data(model)
    data.qpos[layout.objects[:, 0]] = 50
    data.qpos[layout.fingers] = workcell.robot.finger_travel
    missing: dict[tuple[str, ...], float] = {}
    touched = set()
    for index in range(8000):
        limits = workcell.robot.joint_limits
        reaches_out = index % 2 == 1
        uniform = generator.uniform(*limits, layout.arm_joints.shape)
        data.qpos[layout.arm_joints] = stretched(workcell, generator) if reaches_out else uniform
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for geoms, distance in zip(data.contact.geom, data.contact.dist, strict=True):
            pair = frozenset(model.geom(g).name for g in geoms)
            if distance >= 0 or any(geom.startswith("object/") for geom in pair):
                continue
            touched.add(pair)
            if pair not in rows:
                key = tuple(sorted(pair))
                missing[key] = min(missing.get(key, 0.0), float(distance))

    assert not missing
    # Enough rows touch that a missing one would have been seen.
    assert len(touched & rows) >= TOUCHING[name]


@pytest.mark.parametrize("name", [*WORKCELLS, "facing-0.6"])
def test_reach_bounds_every_capsule(name: str) -> None:
    """At random postures, with open fingers, no capsule is farther from the first axis than its reach says."""
    workcell = WORKCELLS.get(name, CLOSE)
    robot = workcell.robot
    item = SceneObject("box", "box", (0.05, 0.05, 0.05), (0.0, 0.6), 0.0)
    scene = Scene((item,), OnRegion("box", Region((0, 0), 0, (0.2, 0.2))), workcell)
    model = build_replay_model(scene)
    layout, data = qpos_layout(scene), build_home_data(model)
    data.qpos[layout.fingers] = robot.finger_travel
    generator = np.random.default_rng(1)
    farthest = np.zeros(len(robot.capsules.names))
    for index in range(500):
        uniform = generator.uniform(*robot.joint_limits, layout.arm_joints.shape)
        data.qpos[layout.arm_joints] = stretched(workcell, generator) if index % 2 else uniform
        mujoco.mj_kinematics(model, data)
        for arm, names in zip(workcell.arms, capsule_names(workcell), strict=True):
            for c, capsule in enumerate(names):
                geom = data.geom(capsule)
                radius, half = model.geom(capsule).size[:2]
                axis = geom.xmat.reshape(3, 3)[:, 2] * half
                ends = [
                    geom.xpos + axis - [*arm.position, 0],
                    geom.xpos - axis - [*arm.position, 0],
                ]
                farthest[c] = max(farthest[c], *(np.hypot(*end[:2]) + radius for end in ends))
    assert (farthest <= robot.capsule_reach + 1e-9).all()
    # The bound is no blunt one: stretched arms come near it.
    assert (farthest > 0.7 * robot.capsule_reach).all()
