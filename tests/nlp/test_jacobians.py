"""Every Jacobian against central differences of its rows."""

import numpy as np
import pytest
from nlp_cases import Floats, pose_in_mode
from nlp_replay import Replay, body_pairs, build_replay_model, clearances
from scipy.spatial.transform import Rotation

from dvr_jax.modes.mode import PARAMETERS

STEP = 1e-5
TOLERANCE = 1e-6

HALF_TURN = 2.9
"""Beyond this angle [rad] the rows of a switch are no longer the quaternion, as documented (`half_rotation_vector`)."""

Rows = dict[str, Floats]


class Compared:
    """Analytic and numeric derivatives of one kind of rows, entry by entry, and where the halved step agrees."""

    def __init__(self, analytic: Floats, whole: Floats, half: Floats) -> None:
        self.comparable = np.abs(whole - half) < TOLERANCE
        if self.comparable.mean() < 0.98:
            raise ValueError(
                f"only {self.comparable.mean():.1%} of the entries lie away from kinks"
            )
        expected = (4 * half - whole) / 3
        self.analytic = analytic
        self.wrong = self.comparable & (
            np.abs(analytic - expected) > TOLERANCE * np.maximum(1, np.abs(expected))
        )

    def require_all(self, where: Floats | bool = True) -> None:
        wrong = self.wrong & where
        assert not wrong.any(), (
            f"{wrong.sum()} of {wrong.size} entries, first at {np.argwhere(wrong)[:5].tolist()}"
        )


def differences(evaluated, kind: str, index: tuple[object, ...]) -> tuple[Rows, Rows]:
    """Difference quotients of all rows with the whole and with half the step."""
    quotients = []
    for step in (STEP, STEP / 2):
        ahead, behind = (evaluated.moved(kind, index, sign * step) for sign in (1, -1))
        quotients.append({name: (ahead[name] - behind[name]) / (2 * step) for name in ahead})
    return quotients[0], quotients[1]


def stacked(columns: list[tuple[Rows, Rows]], *axes: int) -> tuple[Rows, Rows]:
    """Quotients of all columns, the columns' axes first."""
    whole, half = (
        {
            name: np.stack([rows[name] for rows in side]).reshape(*axes, *side[0][name].shape)
            for name in side[0]
        }
        for side in zip(*columns, strict=True)
    )
    return whole, half


def all_joints(evaluated) -> tuple[Rows, Rows]:
    """Derivatives by each joint, joint axis first; moved in all slices at once, as rows of a slice know its own."""
    D = evaluated.joints
    return stacked(
        [differences(evaluated, "q", (slice(None), slice(None), j)) for j in range(D)], D
    )


def all_parameters(evaluated) -> tuple[Rows, Rows]:
    """Derivatives by each mode parameter; axes (action, parameter) first."""
    K = evaluated.case.x.m.shape[1]
    indices = [(slice(None), k, c) for k in range(K) for c in range(PARAMETERS)]
    return stacked([differences(evaluated, "m", index) for index in indices], K, PARAMETERS)


@pytest.fixture(scope="session")
def by_joint(evaluated) -> tuple[Rows, Rows]:
    return all_joints(evaluated)


@pytest.fixture(scope="session")
def by_parameter(evaluated) -> tuple[Rows, Rows]:
    return all_parameters(evaluated)


def groups(evaluated) -> dict[str, slice]:
    """Distances by what they are about, in the order that `dvr_jax.nlp.collision_rows` documents."""
    setting, N = evaluated.case.setting, evaluated.case.number_of_objects
    arm = evaluated.arm_rows
    capsules = setting.model.structure.number_of_capsules * setting.scene.workcell.number_of_arms
    fixed = arm + N * capsules
    table = fixed + setting.number_of_fixed * capsules
    pairs = table + N
    walls = pairs + N * (N - 1) // 2
    return {
        "arm": slice(0, arm),
        "capsule-object": slice(arm, fixed),
        "capsule-fixed": slice(fixed, table),
        "object-table": slice(table, pairs),
        "object-object": slice(pairs, walls),
        "object-fixed": slice(walls, None),
    }


def compare_joints(evaluated, by_joint: tuple[Rows, Rows], group: str) -> Compared:
    analytic = np.moveaxis(
        evaluated.results.distance_jacobian[:, :, : evaluated.joints], 2, 0
    ).copy()
    # By the joints at the sample; those before the first slice lie between it and the home posture, which was not
    # moved.
    case = evaluated.case
    fractions = [
        [case.fraction(b, sample) for sample in range(case.samples)] for b in range(case.batch)
    ]
    analytic[:, :, : case.samples] *= np.array(fractions)[..., None]
    part = groups(evaluated)[group]
    return Compared(analytic[..., part], *(-side["collision"][..., part] for side in by_joint))


def distance_by_parameter(evaluated) -> Floats:
    """(K, 4, B, T', P): the objects' local columns, each given to the action that the object is attached by."""
    case, problems = evaluated.case, evaluated.case.problems
    J = evaluated.results.distance_jacobian[:, :, evaluated.joints :]
    B, T, _, P = J.shape
    K, N = case.x.m.shape[1], case.number_of_objects
    local = J.reshape(B, T, PARAMETERS, N, P)
    total = np.zeros((K, PARAMETERS, B, T, P))
    for b in range(B):
        for t in range(T):
            for n in range(N):
                total[problems.mode_action[b, case.phase(t), n], :, b, t] += local[b, t, :, n]
    return total


def compare_parameters(evaluated, by_parameter: tuple[Rows, Rows], group: str) -> Compared:
    part = groups(evaluated)[group]
    numeric = (-side["collision"][..., part] for side in by_parameter)
    return Compared(distance_by_parameter(evaluated)[..., part], *numeric)


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
    assert not evaluated.results.distance_jacobian[
        :, :, evaluated.joints :, : evaluated.arm_rows
    ].any()


def test_capsules_and_objects(evaluated, by_joint, by_parameter) -> None:
    """Where a capsule's axis does not enter the object, as with fixed bodies below."""
    part = groups(evaluated)["capsule-object"]
    radii = np.tile(evaluated.model.capsule_radii, evaluated.model.structure.number_of_arms)
    distance = evaluated.distance[..., part] + clearances(evaluated.case)[..., part]
    outside = distance > -np.tile(radii, evaluated.case.number_of_objects)
    assert outside.mean() > 0.98
    for compared in (
        compare_joints(evaluated, by_joint, "capsule-object"),
        compare_parameters(evaluated, by_parameter, "capsule-object"),
    ):
        compared.require_all(outside)
        assert np.abs(compared.analytic).max() > 0.1


def test_capsules_and_fixed_bodies(evaluated, by_joint, by_parameter) -> None:
    """Where a capsule's axis does not enter the body: there its depth is that of the axis' deepest point, but for some
    tenths of a millimeter (tests/geometry), and has kinks."""
    if not evaluated.case.setting.number_of_fixed:
        pytest.skip("no fixed bodies")
    radii = np.tile(evaluated.model.capsule_radii, evaluated.model.structure.number_of_arms)
    outside = evaluated.distance[..., groups(evaluated)["capsule-fixed"]]
    outside = outside > -np.tile(radii, evaluated.case.setting.number_of_fixed)
    assert outside.mean() > 0.95
    compared = compare_joints(evaluated, by_joint, "capsule-fixed")
    compared.require_all(outside)
    assert np.abs(compared.analytic * outside).max() > 0.1
    compared = compare_parameters(evaluated, by_parameter, "capsule-fixed")
    compared.require_all()
    assert not compared.analytic.any()


def require_faces(
    evaluated, by_joint: tuple[Rows, Rows], by_parameter: tuple[Rows, Rows], group: str
) -> None:
    """Where a face is nearest (past corners `prism_prism` is inexact: tests/geometry/test_wrenches.py)."""
    scene = evaluated.case.setting.scene
    part = groups(evaluated)[group]
    of_bodies = slice(part.start - evaluated.arm_rows, part.stop and part.stop - evaluated.arm_rows)
    faces = Replay(build_replay_model(scene), evaluated.case).faces(body_pairs(scene)[of_bodies])
    for compared in (
        compare_joints(evaluated, by_joint, group),
        compare_parameters(evaluated, by_parameter, group),
    ):
        moving = (compared.analytic != 0).any(tuple(range(compared.analytic.ndim - 3)))
        if (moving & faces).sum() < 5:
            raise ValueError("too few faces")
        compared.require_all(faces)


def test_objects_face_to_face(level) -> None:
    require_faces(level, all_joints(level), all_parameters(level), "object-object")


def test_objects_and_fixed_bodies_face_to_face(evaluated, by_joint, by_parameter) -> None:
    if not evaluated.case.setting.number_of_fixed:
        pytest.skip("no fixed bodies")
    require_faces(evaluated, by_joint, by_parameter, "object-fixed")


def test_rows_depend_on_their_own_slice_and_the_one_before(evaluated) -> None:
    """The samples up to slice 1 and, short of it, those up to slice 2."""
    M = evaluated.case.samples
    moved = evaluated.moved("q", (slice(None), 1), 0.05)["collision"]
    changed = (np.abs(-moved - evaluated.distance) > 1e-9).any((0, 2))
    np.testing.assert_array_equal(np.flatnonzero(changed), np.arange(M, 3 * M - 1))


def in_half_turn(evaluated) -> Floats:
    """(B, K, 1) switches where the rows are the quaternion."""
    case = evaluated.case
    B, K = case.problems.switched_object.shape
    safe = np.zeros((B, K, 1), bool)
    for b in range(B):
        for k in range(K):
            hands = evaluated.hands_at(b, evaluated.switch_sample(k))
            n = case.problems.switched_object[b, k]
            old, new = (pose_in_mode(case, b, phase, n, hands)[0] for phase in (k, k + 1))
            safe[b, k] = Rotation.from_matrix(old @ new.T).magnitude() < HALF_TURN
    if safe.mean() < 0.8:
        raise ValueError("most of the switches are half turns")
    return safe


def test_switches_by_joints(evaluated, by_joint) -> None:
    """The rows of a switch depend on the last slice of its phase; the joints were moved in all slices."""
    analytic = np.moveaxis(evaluated.results.jacobians["mode_switch"].by_joints, 3, 0)
    compared = Compared(analytic, *(side["mode_switch"] for side in by_joint))
    compared.require_all(in_half_turn(evaluated))
    assert np.abs(analytic).max() > 0.5


def test_switches_by_parameters(evaluated, by_parameter) -> None:
    case, by_own = evaluated.case, evaluated.results.jacobians["mode_switch"].by_parameters
    B, K = case.problems.switched_object.shape
    analytic = np.zeros((K, PARAMETERS, B, K, 6))
    for b in range(B):
        for k in range(K):
            n = case.problems.switched_object[b, k]
            for side in range(2):
                action = case.problems.mode_action[b, k + side, n]
                analytic[action, :, b, k] += by_own[b, k, :, side].T
    Compared(analytic, *(side["mode_switch"] for side in by_parameter)).require_all(
        in_half_turn(evaluated)
    )
    assert np.abs(analytic).max() > 0.5


def test_footprints_by_parameters(evaluated, by_parameter) -> None:
    B, K = evaluated.case.problems.switched_object.shape
    analytic = np.zeros((K, PARAMETERS, B, K, 16))
    for k in range(K):
        analytic[k, :, :, k] = np.moveaxis(evaluated.results.jacobians["footprint"][:, k], 2, 0)
    Compared(analytic, *(side["footprint"] for side in by_parameter)).require_all()
    assert np.abs(analytic).max() > 0.5


def test_footprints_do_not_depend_on_joints(by_joint) -> None:
    assert not by_joint[0]["footprint"].any()
