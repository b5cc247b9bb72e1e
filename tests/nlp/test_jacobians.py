"""Every Jacobian against central differences of its rows."""

import numpy as np
import pytest
from komo_cases import Floats
from komo_replay import Replay, build_replay_model, object_pairs

from dvr_jax.nlp.constraints import ConstraintValues
from dvr_jax.nlp.problem import PARAMETERS

STEP = 1e-5
TOLERANCE = 1e-6
CAPSULES = 18
"""Of both arms."""

HALF_TURN = 2.9
"""Beyond this angle [rad] the switch residual is no longer the quaternion, as documented (`half_rotation_vector`)."""


class Compared:
    """Analytic and numeric derivatives of one kind of rows, entry by entry, and where the halved step agrees."""

    def __init__(self, analytic: Floats, whole: Floats, half: Floats) -> None:
        self.comparable = np.abs(whole - half) < TOLERANCE
        if self.comparable.mean() < 0.98:
            raise ValueError(f"only {self.comparable.mean():.1%} of the entries lie away from kinks")
        expected = (4 * half - whole) / 3
        self.analytic = analytic
        self.wrong = self.comparable & (np.abs(analytic - expected) > TOLERANCE * np.maximum(1, np.abs(expected)))

    def require_all(self, where: Floats | bool = True) -> None:
        wrong = self.wrong & where
        assert not wrong.any(), f"{wrong.sum()} of {wrong.size} entries, first at {np.argwhere(wrong)[:5].tolist()}"


def differences(evaluated, kind: str, index: tuple[object, ...]) -> tuple[ConstraintValues, ConstraintValues]:
    """Difference quotients of all rows with the whole and with half the step."""
    quotients = []
    for step in (STEP, STEP / 2):
        ahead, behind = (evaluated.moved(kind, index, sign * step) for sign in (1, -1))
        quotients.append(ConstraintValues(*((a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True))))
    return quotients[0], quotients[1]


@pytest.fixture(scope="module")
def numeric() -> dict[tuple[int, str], tuple[ConstraintValues, ConstraintValues]]:
    return {}


def stacked(
    columns: list[tuple[ConstraintValues, ConstraintValues]], *axes: int
) -> tuple[ConstraintValues, ConstraintValues]:
    """Quotients of all columns, the columns' axes first."""
    whole, half = (
        ConstraintValues(*(np.stack(rows).reshape(*axes, *rows[0].shape) for rows in zip(*side, strict=True)))
        for side in zip(*columns, strict=True)
    )
    return whole, half


def all_joints(evaluated) -> tuple[ConstraintValues, ConstraintValues]:
    """Derivatives by each joint, joint axis first; moved in all slices at once, as rows of a slice know its own."""
    return stacked([differences(evaluated, "q", (slice(None), slice(None), j)) for j in range(14)], 14)


def all_parameters(evaluated) -> tuple[ConstraintValues, ConstraintValues]:
    """Derivatives by each mode parameter; axes (action, parameter) first."""
    K = evaluated.case.x.m.shape[1]
    indices = [(slice(None), k, c) for k in range(K) for c in range(PARAMETERS)]
    return stacked([differences(evaluated, "m", index) for index in indices], K, PARAMETERS)


@pytest.fixture
def by_joint(evaluated, numeric) -> tuple[ConstraintValues, ConstraintValues]:
    key = (evaluated.case.steps, "q")
    if key not in numeric:
        numeric[key] = all_joints(evaluated)
    return numeric[key]


@pytest.fixture
def by_parameter(evaluated, numeric) -> tuple[ConstraintValues, ConstraintValues]:
    key = (evaluated.case.steps, "m")
    if key not in numeric:
        numeric[key] = all_parameters(evaluated)
    return numeric[key]


def groups(evaluated) -> dict[str, slice]:
    """ConstraintValues by what they are about, in the order that `dvr_jax.nlp.collision_rows` documents."""
    arm, N = evaluated.jacobians.arm_q.shape[-1], evaluated.case.problems.half.shape[1]
    table = arm + N * CAPSULES
    return {
        "arm": slice(0, arm),
        "capsule-object": slice(arm, table),
        "object-table": slice(table, table + N),
        "object-object": slice(table + N, None),
    }


def compare_joints(evaluated, by_joint: tuple[ConstraintValues, ConstraintValues], group: str) -> Compared:
    J = evaluated.jacobians
    analytic = np.moveaxis(np.concatenate([J.arm_q, J.object_q], axis=-1), 2, 0)
    # By the joints at the sample; those before the first slice lie between it and the home posture, which was not
    # moved.
    case = evaluated.case
    shares = [[case.share(b, sample) for sample in range(case.samples)] for b in range(case.batch)]
    analytic[:, :, : case.samples] *= np.array(shares)[..., None]
    part = groups(evaluated)[group]
    return Compared(analytic[..., part], *(side.distance[..., part] for side in by_joint))


def distance_by_parameter(evaluated) -> Floats:
    """(K, 4, B, T', P): the objects' local columns, each given to the action that the object is attached by."""
    J, case, problems = evaluated.jacobians, evaluated.case, evaluated.case.problems
    B, T, _, Po = J.object_m.shape
    K, N = evaluated.case.x.m.shape[1], problems.half.shape[1]
    local = J.object_m.reshape(B, T, PARAMETERS, N, Po)
    total = np.zeros((K, PARAMETERS, B, T, J.arm_q.shape[-1] + Po))
    for b in range(B):
        for t in range(T):
            for n in range(N):
                total[problems.attached_by[b, case.phase(t), n], :, b, t, -Po:] += local[b, t, :, n]
    return total


def compare_parameters(evaluated, by_parameter: tuple[ConstraintValues, ConstraintValues], group: str) -> Compared:
    part = groups(evaluated)[group]
    return Compared(distance_by_parameter(evaluated)[..., part], *(side.distance[..., part] for side in by_parameter))


@pytest.mark.parametrize("group", ["arm", "object-table"])
def test_distances_by_joints(evaluated, by_joint, group: str) -> None:
    compared = compare_joints(evaluated, by_joint, group)
    compared.require_all()
    assert np.abs(compared.analytic).max() > 0.1


@pytest.mark.parametrize("group", ["arm", "object-table"])
def test_distances_by_parameters(evaluated, by_parameter, group: str) -> None:
    compared = compare_parameters(evaluated, by_parameter, group)
    compared.require_all()
    assert np.abs(compared.analytic).max() > 0.1 or group == "arm"
    assert not evaluated.jacobians.arm_m.any()


def test_capsules_and_objects(evaluated, by_joint, by_parameter) -> None:
    for compared in (
        compare_joints(evaluated, by_joint, "capsule-object"),
        compare_parameters(evaluated, by_parameter, "capsule-object"),
    ):
        compared.require_all()
        assert np.abs(compared.analytic).max() > 0.1


def test_objects_face_to_face(level) -> None:
    """Where a face is nearest (past corners `prism_prism` is inexact: tests/geometry/test_wrenches.py)."""
    faces = Replay(build_replay_model(), level.case).faces(object_pairs()[-3:])
    for compared in (
        compare_joints(level, all_joints(level), "object-object"),
        compare_parameters(level, all_parameters(level), "object-object"),
    ):
        moving = (compared.analytic != 0).any(tuple(range(compared.analytic.ndim - 3)))
        if (moving & faces).sum() < 5:
            raise ValueError("too few faces")
        compared.require_all(faces)


def test_rows_depend_on_their_own_slice_and_the_one_before(evaluated) -> None:
    """The samples up to slice 1 and, short of it, those up to slice 2."""
    M = evaluated.case.samples
    moved = evaluated.moved("q", (slice(None), 1), 0.05)
    changed = (np.abs(moved.distance - evaluated.rows.distance) > 1e-9).any((0, 2))
    np.testing.assert_array_equal(np.flatnonzero(changed), np.arange(M, 3 * M - 1))


def in_half_turn(evaluated) -> Floats:
    """(B, K, 1) switches where the residual is the quaternion."""
    safe = evaluated.rows.switch_angle[..., None] < HALF_TURN
    if safe.mean() < 0.8:
        raise ValueError("most of the switches are half turns")
    return safe


def test_switches_by_joints(evaluated, by_joint) -> None:
    """The rows of a switch depend on the last slice of its phase; the joints were moved in all slices."""
    analytic = np.moveaxis(evaluated.jacobians.slopes.switch_q, 3, 0)
    compared = Compared(analytic, *(side.switch for side in by_joint))
    compared.require_all(in_half_turn(evaluated))
    assert np.abs(analytic).max() > 0.5


def test_switches_by_parameters(evaluated, by_parameter) -> None:
    case, J = evaluated.case, evaluated.jacobians
    B, K = case.problems.switched_object.shape
    analytic = np.zeros((K, PARAMETERS, B, K, 6))
    for b in range(B):
        for k in range(K):
            n = case.problems.switched_object[b, k]
            for side in range(2):
                action = case.problems.attached_by[b, k + side, n]
                analytic[action, :, b, k] += J.slopes.switch_m[b, k, :, side].T
    Compared(analytic, *(side.switch for side in by_parameter)).require_all(in_half_turn(evaluated))
    assert np.abs(analytic).max() > 0.5


def test_footprints_by_parameters(evaluated, by_parameter) -> None:
    B, K = evaluated.case.problems.switched_object.shape
    analytic = np.zeros((K, PARAMETERS, B, K, 4))
    for k in range(K):
        analytic[k, :, :, k] = np.moveaxis(evaluated.jacobians.slopes.footprint_m[:, k], 2, 0)
    Compared(analytic, *(side.footprint for side in by_parameter)).require_all()
    assert np.abs(analytic).max() > 0.5


def test_footprints_do_not_depend_on_joints(by_joint) -> None:
    assert not by_joint[0].footprint.any()
