"""The benchmark of motions: each measure against values by hand, on motions that are right and on wrong ones."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from importlib import util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from puppet import Case, carried_box
from puppet_plans import plan_of
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

from dvr_jax.bench import motions, robot_meshes
from dvr_jax.bench.committed import CommittedResults
from dvr_jax.bench.mesh_distances import (
    deepest_penetration,
    least_distances,
    least_of_pairs,
    signed_distance,
)
from dvr_jax.bench.mesh_pairs import GRASPS, Pair, PairKind, make_body
from dvr_jax.bench.motion_figures import motion_distances
from dvr_jax.bench.motion_figures import motions as motion_table
from dvr_jax.bench.motion_limits import limit_uses
from dvr_jax.bench.motion_states import MotionStates, replay_states
from dvr_jax.bench.motion_timing import fastest_duration, moving_parts, time_motion
from dvr_jax.bench.motions import MotionsOptions
from dvr_jax.bench.placement import carried_height, goal_placement
from dvr_jax.bench.slow_hands import switching_rooms
from dvr_jax.checker.loaded_arm import Load, LoadedArm
from dvr_jax.errors import DvrError
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.scene.layout import home_qpos, qpos_layout
from dvr_jax.scene.types import SceneObject
from dvr_jax.workcell.panda import PANDA

Floats = NDArray[np.float64]

needs_meshes = pytest.mark.skipif(
    not (util.find_spec("coal") and util.find_spec("cmeel")),
    reason="needs the wheels coal and example-robot-data (pip install 'dvr_jax[meshes]')",
)


@pytest.fixture(scope="module")
def case() -> Case:
    """The left arm carries a box of 5 x 8 x 10 cm onto the goal; it moves slowly and touches nothing else."""
    return carried_box()


def states_of(case: Case, change: Callable[[Floats], None] | None = None) -> MotionStates:
    """The states of a case's motion, whose states may be changed first."""
    qpos = case.motion.qpos.copy()
    if change is not None:
        change(qpos)
    motion = Motion(case.motion.time, qpos, case.motion.switch)
    return replay_states(case.scene, case.actions, motion)


def bang_bang(case: Case, acceleration: float, steps: int) -> Motion:
    """Joint 1 of the left arm speeds up and slows down at this acceleration, in so many steps of 1 ms each."""
    speed = np.concatenate([np.arange(steps), np.arange(steps, -1, -1)]) * acceleration * 1e-3
    angle = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 1e-3)])
    qpos = np.tile(home_qpos(case.scene), (len(angle), 1))
    qpos[:, qpos_layout(case.scene).arm_joints[0, 0]] += angle
    return make_motion(1e-3 * np.arange(len(angle)), qpos, [])


class TestLimits:
    def test_a_jump_of_the_acceleration_is_a_jerk(self, case: Case) -> None:
        """Bang-bang: the acceleration is 13.5 rad/s^2 of 15, and it changes by twice that within two milliseconds."""
        motion = bang_bang(case, 13.5, 100)
        uses = limit_uses(replay_states(case.scene, [], motion))
        assert uses["velocity"].ratio == pytest.approx(13.5 * 0.1 / 2.175, rel=0.01)
        assert uses["acceleration"].ratio == pytest.approx(0.9, rel=1e-6)
        assert uses["jerk"].ratio == pytest.approx(2 * 13.5 / 2e-3 / 7500, rel=0.01)
        assert uses["jerk"].joint == "left/joint1" and uses["jerk"].time == pytest.approx(
            0.1, abs=3e-3
        )

    def test_the_end_of_a_motion_counts(self, case: Case) -> None:
        """A motion that is cut off at full speed stops within a millisecond."""
        whole = bang_bang(case, 13.5, 100)
        cut = make_motion(whole.time[:100], whole.qpos[:100], [])
        assert limit_uses(replay_states(case.scene, [], cut))["acceleration"].ratio > 10

    def test_finger_speed(self, case: Case) -> None:
        """The puppet's fingers move at 40 mm/s of 50, more in between by the overshoot of the spline."""
        assert 0.79 < limit_uses(states_of(case))["finger speed"].ratio < 1.0

    def test_a_load_presses_by_its_lever(self) -> None:
        """At rest: mass times gravity times the horizontal distance from the axis of joint 2, which is horizontal."""
        item = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (0.0, 0.0), 0.0)
        load = Load(item, np.array([0.01, 0.02, 0.13]), np.eye(3))
        q = np.array([PANDA.home])
        rest = np.zeros((1, 7))
        more = LoadedArm(PANDA, load).torques(q, rest, rest) - LoadedArm(PANDA).torques(
            q, rest, rest
        )

        data = mujoco.MjData(PANDA.model)
        data.qpos[:7] = q[0]
        mujoco.mj_kinematics(PANDA.model, data)
        hand = data.body("hand")
        lever = (hand.xpos + hand.xmat.reshape(3, 3) @ load.position)[0]
        assert abs(more[0, 1]) == pytest.approx(0.3 * 0.4 * 9.81 * lever, rel=1e-6)


class TestTiming:
    def test_the_fastest_motion_of_a_joint_is_a_trapezoid(self) -> None:
        """Distance / speed + speed / acceleration."""
        points = np.zeros((401, 2))
        points[:, 0] = np.linspace(0, 3.0, 401)
        limits = [
            JointVelocityConstraint(np.array([[-2.0, 2.0]] * 2)),
            JointAccelerationConstraint(np.array([[-10.0, 10.0]] * 2)),
        ]
        assert fastest_duration(points, limits) == pytest.approx(3.0 / 2 + 2 / 10, rel=2e-3)

    def test_a_fast_motion_is_as_fast_as_topp_ra(self, case: Case) -> None:
        """Bang-bang at 14 rad/s^2 of 15 takes sqrt(15 / 14) as long; at twice the time, twice as long."""
        motion = bang_bang(case, 14.0, 100)
        timing = time_motion(replay_states(case.scene, [], motion))
        assert timing.moving / timing.fastest == pytest.approx(math.sqrt(15 / 14), rel=0.01)
        assert timing.fastest_with_torque == pytest.approx(timing.fastest, rel=0.01)

        slow = make_motion(2 * motion.time, motion.qpos, [])
        twice = time_motion(replay_states(case.scene, [], slow))
        assert twice.moving / twice.fastest == pytest.approx(2 * math.sqrt(15 / 14), rel=0.01)

    def test_moving_parts_leave_out_the_fingers(self, case: Case) -> None:
        """Between two switches from the first to the last motion of an arm; the fingers move in between."""
        states = states_of(case)
        layout = qpos_layout(case.scene)
        q = case.motion.qpos[:, layout.arm_joints.reshape(-1)]
        parts = moving_parts(case.motion, q)
        assert len(parts) == 3
        travels = case.motion.qpos[:, layout.fingers[0]]
        for part in parts:
            inside = travels[part.first : part.last + 1]
            np.testing.assert_allclose(inside, np.tile(inside[:1], (len(inside), 1)))
        assert switching_rooms(states, 0) == {}
        # The box is grasped across its width; each finger can open to 4 cm from the middle.
        width = case.scene.objects[0].size[0]
        rooms = switching_rooms(states, parts[0].last)
        assert rooms == {0: pytest.approx(0.04 - width / 2, abs=1e-3)}

        timing = time_motion(states)
        assert timing.moving < timing.duration - 0.5
        assert timing.fastest <= timing.fastest_with_slow_hands <= 1.01 * timing.moving


class TestPlacement:
    def test_the_box_stands_in_the_middle(self, case: Case) -> None:
        """Half of 14 cm less half of 8 cm."""
        placement = goal_placement(states_of(case))
        assert placement.edge == pytest.approx(0.03, abs=1e-4) and placement.is_clear

    def test_a_box_near_an_edge_is_neither_clear_nor_centered(self, case: Case) -> None:
        """By 28 mm along the region's y."""
        columns = qpos_layout(case.scene).objects[0, :2]

        def shift(qpos: Floats) -> None:
            qpos[-1, columns] += 0.028 * np.array([-np.sin(0.2), np.cos(0.2)])

        placement = goal_placement(states_of(case, shift))
        assert placement.edge == pytest.approx(0.002, abs=1e-4) and not placement.is_clear

    def test_the_least_height_of_what_is_carried(self, case: Case) -> None:
        """In the middle between both switches the box is lowered to 3 mm; at the switches it stands on the table."""
        assert carried_height(states_of(case)) > 0.02
        first, last = case.motion.switch.tolist()
        pose = qpos_layout(case.scene).objects[0, 2:]

        def lower(qpos: Floats) -> None:
            qpos[(first + last) // 2, pose] = [0.05 + 0.003, 1.0, 0.0, 0.0, 0.0]

        least = carried_height(states_of(case, lower))
        assert least == pytest.approx(0.003, abs=1e-6)


@needs_meshes
class TestMeshes:
    def test_boxes_and_cylinders_by_hand(self) -> None:
        """A cylinder comes down onto a box: the gap, and the depth once it is within."""
        import coal

        heights = np.linspace(0.30, 0.195, 50)
        up = np.stack([np.zeros(50), np.zeros(50), heights], axis=1)
        still = np.tile(np.eye(3), (50, 1, 1))
        box = make_body("box", coal.Box(0.1, 0.2, 0.3), np.zeros((50, 3)), still)
        cylinder = make_body("cylinder", coal.Cylinder(0.03, 0.1), up, still)
        pair = Pair(PairKind.OBJECT_OBJECT, box, cylinder, np.ones(50, bool))
        for state in (0, 20, 49):
            assert signed_distance(pair, state) == pytest.approx(heights[state] - 0.20, abs=1e-6)
        least = least_of_pairs([pair], np.arange(50.0))
        assert least[PairKind.OBJECT_OBJECT].distance == pytest.approx(-0.005, abs=1e-6)
        assert deepest_penetration(least) == pytest.approx(0.005, abs=1e-6)

    def test_no_state_is_skipped_that_matters(self) -> None:
        """The least distance of a tumbling box is the least of all states."""
        import coal

        generator = np.random.default_rng(0)
        angles = np.cumsum(generator.normal(0, 0.1, 300))
        turns = np.zeros((300, 3, 3))
        for state, angle in enumerate(angles):
            turns[state] = [
                [np.cos(angle), 0, np.sin(angle)],
                [0, 1, 0],
                [-np.sin(angle), 0, np.cos(angle)],
            ]
        ways = np.array([0.0, 0.0, 0.25]) + np.cumsum(generator.normal(0, 2e-3, (300, 3)), axis=0)
        box = make_body("box", coal.Box(0.3, 0.1, 0.1), ways, turns)
        other = make_body(
            "hand", robot_meshes.panda_bodies()["hand"], 0 * ways, 0 * turns + np.eye(3)
        )
        valid = generator.random(300) < 0.7
        pair = Pair(PairKind.HAND_OBJECT, box, other, valid)
        least = least_of_pairs([pair], np.arange(300.0))[PairKind.HAND_OBJECT]
        every = [signed_distance(pair, state) for state in np.flatnonzero(valid)]
        assert least.distance == pytest.approx(min(every), abs=1e-6)

    def test_the_convex_bodies_are_the_meshes(self) -> None:
        """The volumes of mesh and convex hull agree, and a finger is as long as Franka's: 53.9 mm."""
        import coal

        folder = robot_meshes.find_mesh_folder()
        for body, mesh in robot_meshes.PANDA_MESHES.items():
            loaded = coal.MeshLoader().load(str(folder / f"{mesh}.stl"), np.ones(3))
            convex = robot_meshes.panda_bodies()[body]
            assert loaded.computeVolume() == pytest.approx(convex.computeVolume(), rel=1e-3)
            if mesh == "finger":
                points = np.array([convex.point(i) for i in range(convex.num_points)])
                assert points[:, 2].max() == pytest.approx(0.0539, abs=3e-4)
                side = 1 if body == "finger_left" else -1
                assert (side * points[:, 1]).min() == pytest.approx(0.0, abs=3e-4)

    def test_a_right_motion_penetrates_nothing(self, case: Case) -> None:
        least = least_distances(states_of(case))
        assert deepest_penetration(least) < 5e-5
        assert least[PairKind.FINGER_GRASP].distance == pytest.approx(-1e-4, abs=1e-4)

        # The gripper center is 7 cm above the table, and the finger tips reach 8.9 mm beyond it.
        assert least[PairKind.HAND_TABLE].distance == pytest.approx(0.07 - 0.0089, abs=5e-4)
        assert least[PairKind.ARM_ARM].distance > 0.1

    def test_penetrations_are_found_by_their_depth(self, case: Case) -> None:
        """The held box is 4 mm in the table for one state."""
        first, last = case.motion.switch.tolist()
        pose = qpos_layout(case.scene).objects[0, 2:]

        def lower(qpos: Floats) -> None:
            qpos[(first + last) // 2, pose] = [0.05 - 0.004, 1.0, 0.0, 0.0, 0.0]

        found = least_distances(states_of(case, lower))[PairKind.OBJECT_TABLE]
        assert found.distance == pytest.approx(-0.004, abs=1e-5)
        assert found.time == pytest.approx(float(case.motion.time[(first + last) // 2]))

    def test_a_hand_in_another_object_is_no_grasp(self, case: Case) -> None:
        """The can stands where the fingers close on the box."""
        columns = qpos_layout(case.scene).objects[1, :2]

        def put_can(qpos: Floats) -> None:
            qpos[:, columns] = [-0.20, 0.20]

        least = least_distances(states_of(case, put_can))
        assert least[PairKind.HAND_OBJECT].distance < -0.01
        assert deepest_penetration(least) > 0.01

    def test_closed_fingers_in_the_grasped_box_are_named_apart(self, case: Case) -> None:
        fingers = qpos_layout(case.scene).fingers[0]
        switch = int(case.motion.switch[0])

        def close(qpos: Floats) -> None:
            qpos[switch : switch + 5, fingers] = 0.015

        least = least_distances(states_of(case, close))
        assert PairKind.FINGER_GRASP in GRASPS
        assert least[PairKind.FINGER_GRASP].distance == pytest.approx(-0.010, abs=2e-4)
        assert deepest_penetration(least) < 5e-5


def test_rows_tables_and_figures(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows of a plan and of a scene without one; what is printed comes out of a file that has all rows."""
    meshes = util.find_spec("coal") is not None
    plans = [plan_of(case, case.motion), plan_of(case, None)]
    monkeypatch.setattr(motions, "plan_scene", lambda options, index, termination: plans[index])
    file = tmp_path / "bench/results/motions/two.jsonl"
    options = MotionsOptions(number=2, out=file, meshes=meshes)
    rows = [motions._measure_one(options, index) for index in range(2)]
    assert [row["length"] for row in rows] == [2, 0]
    assert rows[0]["edge_mm"] == pytest.approx(30.0, abs=0.1)
    assert rows[0]["check_ms"] > 0

    header: dict[str, Any] = {
        "options": motions.header_options(options),
        "machine": "Abacus",
        "cores": 3,
        "versions": {"dvr_jax": "1.2"},
    }
    file.parent.mkdir(parents=True)
    file.write_text("".join(json.dumps(row) + "\n" for row in [header, *rows]))
    arguments = ["--number", "2", "--out", str(file), *(["--meshes"] if meshes else [])]
    assert motions.run(arguments) == 0
    printed = capsys.readouterr().out
    assert "optimal paths: 1 solved" in printed
    line = next(line for line in printed.splitlines() if line.startswith("  all "))
    assert line.split()[1:3] == ["1", f"{rows[0]['duration']:.2f}"]
    assert "nor centered: 0" in printed
    assert ("hand and table" in printed) == meshes

    results = CommittedResults(tmp_path)
    assert "| plans | 1 of 2 |" in motion_table(results)
    assert f"| {rows[0]['duration']:.2f} (" in motion_table(results)
    if meshes:
        table = rows[0]["distances"]["hand and table"]["mm"]
        assert f"| hand and table | {table:.2f} (median {table:.2f}) |" in motion_distances(results)


def test_missing_meshes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_meshes.util, "find_spec", lambda name: None)
    MotionsOptions(number=1).check()
    with pytest.raises(DvrError, match=r"need the wheels coal and example-robot-data; install"):
        MotionsOptions(number=1, meshes=True).check()


def test_wrong_options_are_refused() -> None:
    with pytest.raises(DvrError, match="--number is 0"):
        list(motions.measure_scenes(replace(MotionsOptions(), number=0)))
