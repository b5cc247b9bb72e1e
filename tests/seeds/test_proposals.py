"""Proposals reach what they say: their grippers hold the object where the modes have it."""

from typing import NamedTuple

import jax
import numpy as np
import pytest
from nlp_cases import FACING, SIDE_BY_SIDE, SINGLE_ARM, Floats, Setting, grasp, place
from scipy.spatial.transform import Rotation

from dvr_jax.geometry.footprint import Rectangle, signed_distance
from dvr_jax.logic import Action
from dvr_jax.modes.mode import Attachment, HandPoses, ModeKind, ObjectPoses
from dvr_jax.modes.poses import object_poses
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, operator_of
from dvr_jax.operators.grasp import (
    LARGEST_GRASP,
    MEETING_ACROSS,
    MEETING_ALONG,
    MEETING_HEIGHT,
    MEETING_TILT,
)
from dvr_jax.operators.place import PLACING_ANGLE, PLACING_RADIUS
from dvr_jax.operators.proposal import (
    UNIFORM_NUMBERS,
    BeamStep,
    ObjectBefore,
    Proposal,
    ProposedPoses,
)
from dvr_jax.seeds.beam_batches import MEETING_FORWARD, beam_step
from dvr_jax.workcell.workcell import (
    DEFAULT_WORKCELL,
    SIDE_BY_SIDE_WORKCELL,
    WORKCELLS,
    Workcell,
    base_positions,
    base_rotations,
)

CANDIDATES, PROPOSALS = 5, 64
TOLERANCE = {"rtol": 0, "atol": 3e-6}
"""Proposals are float32."""


class Sampled(NamedTuple):
    """Proposals of one prefix, the last action of some sequence."""

    problem: Problem
    step: BeamStep
    before: ObjectBefore
    found: ProposedPoses

    @property
    def item(self) -> int:
        return int(self.step.item[0])

    def attachment(
        self, kind: int, parent: int, closing_yaw: float, parameters: Floats
    ) -> Attachment:
        """Of the switched object in every proposal, parameters (4, B, J)."""
        L = CANDIDATES * PROPOSALS
        k = self.item

        def everywhere(value: float | Floats) -> Floats:
            return np.broadcast_to(
                np.asarray(value, float)[..., None, None], (*np.shape(value), 1, L)
            )

        return Attachment(
            kind=np.full((1, L), kind, np.int32),
            parent=np.full((1, L), parent, np.int32),
            parameters=np.asarray(
                np.broadcast_to(parameters, (4, CANDIDATES, PROPOSALS)), float
            ).reshape(4, 1, L),
            closing_yaw=everywhere(closing_yaw),
            initial_pose=everywhere(self.problem.initial_pose[k]),
            half_height=everywhere(self.problem.prism[k, 2]),
        )

    def parameters_before(self) -> Floats:
        """(4, B, 1)."""
        return np.asarray(self.before.parameters)[0].T[:, :, None]

    def held_by(self, gripper: int, attached: Attachment) -> ObjectPoses:
        """Poses of the object as the proposed gripper holds it; the attachment's parent is arm 0."""
        R = np.asarray(self.found.rotation, float)[gripper, :, :, 0].reshape(3, 3, 1, -1)
        p = np.asarray(self.found.position, float)[gripper, :, 0].reshape(3, 1, -1)
        return object_poses(attached, HandPoses(R, p))

    def as_taken(self) -> ObjectPoses:
        """As the acting gripper holds it after a grasp."""
        m = np.asarray(self.found.m)[:, 0]
        return self.held_by(
            0, self.attachment(ModeKind.HELD, 0, float(self.step.closing_yaw[0]), m)
        )

    def as_given(self, gripper: int) -> ObjectPoses:
        """As the gripper that held it before holds it."""
        yaw = float(self.before.closing_yaw[0])
        return self.held_by(
            gripper, self.attachment(ModeKind.HELD, 0, yaw, self.parameters_before())
        )

    def standing(self, kind: int, parameters: Floats) -> ObjectPoses:
        L = CANDIDATES * PROPOSALS
        nowhere = HandPoses(np.zeros((3, 3, 1, L)), np.zeros((3, 1, L)))
        return object_poses(self.attachment(kind, 0, 0.0, parameters), nowhere)


def sample(
    setting: Setting, actions: list[Action], ignored: tuple[str, ...] = (), seed: int = 0
) -> Sampled:
    """Proposals of the last action; the object's parameters before it are random within their bounds."""
    problem = transcribe(setting.scene, actions, ignored)
    k = len(actions) - 1
    item = problem.switched_object[k]
    kind = ModeKind(problem.mode_kind[k, item])
    proposal = proposal_of(actions[-1], kind)
    step = jax.tree.map(lambda leaf: np.asarray(leaf)[None], beam_step(problem, proposal))

    generator = np.random.default_rng(seed)
    by = problem.mode_action[k, item]
    if kind == ModeKind.HELD:
        low, high = (
            np.clip(b[by], -1.0, 1.0) for b in (problem.parameter_lower, problem.parameter_upper)
        )
    else:
        low, high = np.array([-0.4, -0.4, -3, 0]), np.array([0.4, 0.4, 3, 0])
    before = ObjectBefore(
        kind=np.array([kind], np.int32),
        closing_yaw=np.array(
            [problem.closing_yaw[by] if kind == ModeKind.HELD else 0.0], np.float32
        ),
        parameters=generator.uniform(low, high, (1, CANDIDATES, 4)).astype(np.float32),
    )
    u = generator.random((UNIFORM_NUMBERS, CANDIDATES, PROPOSALS), np.float32)
    return Sampled(
        problem, step, before, jax.tree.map(np.asarray, proposal.propose(step, before, u))
    )


def proposal_of(action: Action, kind: ModeKind) -> Proposal:
    return operator_of(action, OPERATORS).proposal(kind)


def require_same(first: ObjectPoses, second: ObjectPoses) -> None:
    np.testing.assert_allclose(first.position, second.position, **TOLERANCE)
    np.testing.assert_allclose(first.rotation, second.rotation, **TOLERANCE)


SETTINGS = {"facing": FACING, "side by side": SIDE_BY_SIDE, "single": SINGLE_ARM}
WITH_TWO_ARMS = {"facing": FACING, "side by side": SIDE_BY_SIDE}


def last_arm(setting: Setting) -> str:
    return setting.scene.workcell.arm_names[-1]


def test_the_proposal_depends_on_the_mode_before() -> None:
    action = grasp("left", "+x", "yellow")
    names = {
        kind: proposal_of(action, kind).name
        for kind in (ModeKind.FIXED, ModeKind.PLACED, ModeKind.HELD)
    }
    assert names == {ModeKind.FIXED: "grasp", ModeKind.PLACED: "grasp", ModeKind.HELD: "handover"}
    assert proposal_of(place("left", "yellow", "table"), ModeKind.HELD).name == "place"


@pytest.mark.parametrize("face", ["+x", "-y"])
@pytest.mark.parametrize("item", ["yellow", "can"])
@pytest.mark.parametrize("name", SETTINGS)
def test_grasps_of_what_the_scene_has(name: str, item: str, face: str) -> None:
    sampled = sample(SETTINGS[name], [grasp(last_arm(SETTINGS[name]), face, item)])
    require_same(sampled.as_taken(), sampled.standing(ModeKind.FIXED, np.zeros((4, 1, 1))))
    require_within_bounds(sampled)
    assert not sampled.found.overhang.any()
    assert sampled.found.position.shape == (1, 3, 1, CANDIDATES, PROPOSALS)


@pytest.mark.parametrize("item", ["yellow", "can"])
@pytest.mark.parametrize("name", SETTINGS)
def test_grasps_of_what_was_placed(name: str, item: str) -> None:
    """Where each candidate has placed it, and no longer where the scene has it."""
    arm = last_arm(SETTINGS[name])
    actions = [grasp(arm, "+x", item), place(arm, item, "table"), grasp(arm, "+y", item)]
    sampled = sample(SETTINGS[name], actions)
    assert sampled.before.kind == ModeKind.PLACED
    require_same(sampled.as_taken(), sampled.standing(ModeKind.PLACED, sampled.parameters_before()))
    require_within_bounds(sampled)


def require_within_bounds(sampled: Sampled) -> None:
    """The bounds of the NLP, or the narrower ones of proposals; they are used to the full."""
    k = len(sampled.problem.switched_object) - 1
    wide = np.array(LARGEST_GRASP)
    low = np.clip(sampled.problem.parameter_lower[k], -wide, wide)[:, None]
    high = np.clip(sampled.problem.parameter_upper[k], -wide, wide)[:, None]
    m = sampled.found.m.reshape(4, -1)
    assert (m >= low - 1e-6).all() and (m <= high + 1e-6).all()
    spread = np.ptp(m, axis=1)
    assert (spread >= 0.9 * (high - low)[:, 0]).all()
    assert not spread[(high - low)[:, 0] == 0].any()


@pytest.mark.parametrize("item", ["yellow", "can"])
@pytest.mark.parametrize(("giver", "taker"), [("left", "right"), ("right", "left")])
@pytest.mark.parametrize("name", WITH_TWO_ARMS)
def test_handovers(name: str, giver: str, taker: str, item: str) -> None:
    """Both grippers hold the object in one place, which is in the region where the arms meet."""
    setting = WITH_TWO_ARMS[name]
    sampled = sample(setting, [grasp(giver, "+x", item), grasp(taker, "-y", item)])
    workcell = setting.scene.workcell
    assert sampled.found.position.shape == (2, 3, 1, CANDIDATES, PROPOSALS)
    assert sampled.step.acting_arm == workcell.arm_index(taker)
    assert sampled.step.giving_arm == workcell.arm_index(giver)
    taken, given = sampled.as_taken(), sampled.as_given(1)
    require_same(taken, given)
    require_within_bounds(sampled)

    p = np.asarray(taken.position)[:, 0]
    axis, center = sampled.step.meeting_axis[0], sampled.step.meeting_center[0]
    along = axis @ (p[:2] - center[:, None])
    across = np.array([-axis[1], axis[0]]) @ (p[:2] - center[:, None])
    for values, low, high in (
        (along, -MEETING_ALONG, MEETING_ALONG),
        (across, -MEETING_ACROSS, MEETING_ACROSS),
        (p[2], *MEETING_HEIGHT),
    ):
        assert low - 1e-5 <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high + 1e-5
    tilt = np.arccos(np.clip(np.asarray(taken.rotation)[2, 2, 0], -1, 1))
    assert 0.9 * MEETING_TILT < tilt.max() <= MEETING_TILT + 1e-5
    # Every direction of the object's own x axis occurs.
    heading = np.arctan2(*np.asarray(taken.rotation)[0, 1::-1, 0])
    assert np.histogram(heading, 8, (-np.pi, np.pi))[0].min() > 0


@pytest.mark.parametrize("item", ["yellow", "can", "green"])
@pytest.mark.parametrize("support", ["table", "goal"])
@pytest.mark.parametrize("name", SETTINGS)
def test_placements(name: str, support: str, item: str) -> None:
    """The gripper puts the object where the parameters say.

    The overhang is what sticks out of the support, and what covers a region that has to be clear.
    """
    setting = SETTINGS[name]
    if item not in setting.scene.object_names:
        pytest.skip("no such object")
    arm = last_arm(setting)
    sampled = sample(setting, [grasp(arm, "+x", item), place(arm, item, support)])
    m = sampled.found.m[:, 0]
    require_same(sampled.as_given(0), sampled.standing(ModeKind.PLACED, m))
    assert not m[3].any()
    expected = sticking_out(sampled) + covering(setting, sampled, item)
    # At a corner of a region, a disc counts as its bounding square.
    radius = sampled.problem.prism[sampled.item, 3]
    excess = sampled.found.overhang[0] - expected.reshape(m.shape[1:])
    assert excess.min() > -1e-6 and excess.max() < (np.sqrt(2) - 1) * radius + 1e-6
    if support == "goal":
        require_spread_on_region(sampled)
    else:
        require_ahead_of_arm(sampled, setting.scene.workcell, arm)


def local_offsets(sampled: Sampled) -> tuple[Floats, Floats]:
    """Centers in the support's frame (2, L), and how far the object reaches from them along its sides (2, L)."""
    hx, hy, _, r = sampled.problem.prism[sampled.item]
    x, y, yaw, _ = np.asarray(sampled.found.m, float).reshape(4, -1)
    cx, cy, support_yaw, _, _ = sampled.problem.support[-1]
    back = Rotation.from_euler("z", -support_yaw).as_matrix()[:2, :2]
    corners = np.array([[sx * hx, sy * hy] for sx in (-1, 1) for sy in (-1, 1)])
    turns = Rotation.from_euler("z", (yaw - support_yaw)[:, None]).as_matrix()[:, :2, :2]
    reach = np.abs(np.einsum("lij,cj->cli", turns, corners)).max(0).T + r
    return back @ [x - cx, y - cy], reach


def sticking_out(sampled: Sampled) -> Floats:
    """By how much the object sticks out of its support at both sides together, along x plus along y [m]."""
    center, reach = local_offsets(sampled)
    beyond = np.abs(center) + reach - sampled.problem.support[-1][3:, None]
    return np.maximum(beyond, 0).sum(0)


def covering(setting: Setting, sampled: Sampled, item: str) -> Floats:
    """By how much the object covers the regions that have to be clear, by exact distances of footprints [m]."""
    thing = setting.scene.objects[setting.scene.object_index(item)]
    covered = np.zeros(CANDIDATES * PROPOSALS)
    m = np.asarray(sampled.found.m, float)[:, 0].reshape(4, -1)
    for x, y, yaw, width, depth in sampled.problem.kept_clear[-1]:
        region = Rectangle((x, y), (width, depth), yaw)
        for index, pose in enumerate(m.T):
            footprint = thing.kind.footprint(thing.size, (pose[0], pose[1]), pose[2])
            covered[index] += max(-signed_distance(footprint, region), 0)
    return covered


def require_spread_on_region(sampled: Sampled) -> None:
    """Half of the yaws are along the region's sides, and positions fill the room that there is."""
    turn = np.asarray(sampled.found.m, float)[2].ravel() - sampled.problem.support[-1][2]
    quarter = np.abs(np.remainder(turn + np.pi / 4, np.pi / 2) - np.pi / 4) < 1e-5
    assert 0.4 < quarter.mean() < 0.6
    center, reach = local_offsets(sampled)
    room = np.maximum(sampled.problem.support[-1][3:, None] - reach, 0)
    assert (np.abs(center) <= room + 1e-6).all()
    has_room = room > 0.01
    share = center[has_room] / room[has_room]
    assert share.min() < -0.9 and share.max() > 0.9


def require_ahead_of_arm(sampled: Sampled, workcell: Workcell, arm: str) -> None:
    """In a ring sector before the acting arm, or at the table's border."""
    index = workcell.arm_index(arm)
    x, y = np.asarray(sampled.found.m, float)[:2].reshape(2, -1)
    center, reach = local_offsets(sampled)
    room = sampled.problem.support[-1][3:, None] - reach
    assert (np.abs(center) <= room + 1e-6).all()
    at_border = (np.abs(center) > room - 1e-5).any(0)
    assert at_border.mean() < 0.5
    local = base_rotations(workcell)[index, :2, :2].T @ (
        [x, y] - base_positions(workcell)[index, :2, None]
    )
    distance, angle = np.hypot(*local), np.arctan2(local[1], local[0])
    near, far = PLACING_RADIUS
    assert (distance[~at_border] >= near - 1e-5).all() and (distance <= far + 1e-5).all()
    assert (np.abs(angle[~at_border]) <= PLACING_ANGLE + 1e-5).all()


def test_an_object_that_does_not_fit_at_a_yaw_sticks_out() -> None:
    """The box is 16 cm long, the region 20 cm: some turns leave no room. Those count as overhang, the others do not."""
    sampled = sample(FACING, [grasp("left", "+x", "yellow"), place("left", "yellow", "goal")])
    small = sampled.step.support.copy()
    small[0, 3:] = [0.085, 0.05]
    u = np.random.default_rng(1).random((UNIFORM_NUMBERS, CANDIDATES, PROPOSALS), np.float32)
    proposal = proposal_of(place("left", "yellow", "goal"), ModeKind.HELD)
    found = jax.tree.map(
        np.asarray, proposal.propose(sampled.step._replace(support=small), sampled.before, u)
    )
    support = sampled.problem.support.copy()
    support[-1] = small[0]
    again = sampled._replace(problem=sampled.problem._replace(support=support), found=found)
    np.testing.assert_allclose(found.overhang.ravel(), sticking_out(again), atol=1e-6)
    assert 0.3 < (found.overhang > 0).mean() < 0.9
    assert found.overhang.max() > 0.02


def test_facing_arms_get_mirror_images_on_the_table() -> None:
    """Of the right arm's placements those of the left one are the images with x reversed."""
    left, right = (
        sample(FACING, [grasp(arm, "+x", "can"), place(arm, "can", "table")]).found.m
        for arm in ("left", "right")
    )
    np.testing.assert_allclose(left[0], -right[0], atol=1e-6)
    np.testing.assert_allclose(left[1:], right[1:], atol=1e-6)


def test_a_prefix_gets_the_same_whatever_its_batch() -> None:
    """Three prefixes together, as they are alone."""
    skeletons = [
        [grasp("left", "+x", "yellow"), place("left", "yellow", "table")],
        [grasp("right", "+y", "can"), place("right", "can", "goal")],
        [grasp("left", "+y", "green"), place("left", "green", "goal")],
    ]
    alone = [sample(FACING, skeleton) for skeleton in skeletons]
    steps, befores = (
        jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
        for parts in ([one.step for one in alone], [one.before for one in alone])
    )
    u = np.random.default_rng(0)
    u.uniform(size=(1, CANDIDATES, 4))
    numbers = u.random((UNIFORM_NUMBERS, CANDIDATES, PROPOSALS), np.float32)
    together = proposal_of(skeletons[0][-1], ModeKind.HELD).propose(steps, befores, numbers)
    for index, one in enumerate(alone):
        np.testing.assert_allclose(np.asarray(together.m)[:, index], one.found.m[:, 0], **TOLERANCE)
        np.testing.assert_allclose(
            np.asarray(together.position)[:, :, index], one.found.position[:, :, 0], **TOLERANCE
        )
        np.testing.assert_allclose(
            np.asarray(together.overhang)[index], one.found.overhang[0], **TOLERANCE
        )


def meeting_region(workcell: Workcell, giver: int, taker: int) -> tuple[Floats, Floats]:
    names = workcell.arm_names
    scene = Setting(FACING.scene, ()).scene
    scene = type(scene)(scene.objects, scene.goal, workcell)
    actions = [grasp(names[giver], "+x", "yellow"), grasp(names[taker], "-y", "yellow")]
    step = beam_step(transcribe(scene, actions), proposal_of(actions[-1], ModeKind.HELD))
    return np.asarray(step.meeting_center), np.asarray(step.meeting_axis)


@pytest.mark.parametrize("name", ["facing", "facing-1.0", "facing-1.6"])
def test_facing_arms_meet_in_the_middle(name: str) -> None:
    for giver, taker in ((0, 1), (1, 0)):
        center, axis = meeting_region(WORKCELLS[name], giver, taker)
        np.testing.assert_allclose(center, [0, 0], atol=1e-7)
        np.testing.assert_allclose(axis, [1, 0], atol=1e-7)


def test_arms_side_by_side_meet_in_front_of_their_middle() -> None:
    for giver, taker in ((0, 1), (1, 0)):
        center, axis = meeting_region(SIDE_BY_SIDE_WORKCELL, giver, taker)
        np.testing.assert_allclose(center, [0, -0.3 + MEETING_FORWARD], atol=1e-7)
        np.testing.assert_allclose(axis, [1, 0], atol=1e-7)


REACHABLE = {"facing": 0.2, "facing-1.0": 0.4, "facing-1.6": 0.06, "side-by-side": 0.4}
"""Least share of the meeting region that both arms reach: it shrinks fast with the distance of the bases."""


@pytest.mark.parametrize("name", REACHABLE)
def test_both_arms_reach_a_part_of_the_meeting_region(name: str) -> None:
    """A gripper is at most 0.855 m from its shoulder, Franka's published reach."""
    workcell = WORKCELLS[name]
    center, axis = meeting_region(workcell, 0, 1)
    generator = np.random.default_rng(0)
    along, across, height = generator.uniform(
        [-MEETING_ALONG, -MEETING_ACROSS, MEETING_HEIGHT[0]],
        [MEETING_ALONG, MEETING_ACROSS, MEETING_HEIGHT[1]],
        (4000, 3),
    ).T
    p = np.column_stack(
        [*(center[:, None] + np.outer(axis, along) + np.outer([-axis[1], axis[0]], across)), height]
    )
    shoulders = base_positions(workcell) + np.array([0, 0, 0.333])
    reachable = (np.linalg.norm(p[:, None] - shoulders, axis=2) < 0.855).all(1)
    assert reachable.mean() > REACHABLE[name]


def test_the_default_workcells_region_is_as_before() -> None:
    """The box of version 0.8: x within 0.25 m, y within 0.4 m, z from 0.15 to 0.6 m."""
    center, axis = meeting_region(DEFAULT_WORKCELL, 1, 0)
    assert (center == 0).all() and (axis == [1, 0]).all()
    assert (MEETING_ALONG, MEETING_ACROSS, MEETING_HEIGHT) == (0.25, 0.4, (0.15, 0.6))
