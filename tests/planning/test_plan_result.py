"""`Plan`: its one line, the files that it is read back from, and the scene that it leaves behind.

The plans are made by hand: their motions jump, but they are what files and the scene afterwards depend on.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvr_jax.checker import CheckReport
from dvr_jax.errors import DataError, DvrError, MotionError
from dvr_jax.geometry.footprint import signed_distance
from dvr_jax.goals import Goal, Inside, On
from dvr_jax.logic import Action
from dvr_jax.motion import load_motion, make_motion, save_motion
from dvr_jax.planning.path_quality import PathQuality
from dvr_jax.planning.result import Plan
from dvr_jax.scene.mjcf import home_qpos, qpos_layout
from dvr_jax.scene.types import FixedBody, OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import validate_scene
from dvr_jax.search.explanation import Refutation
from dvr_jax.search.reasons import Reason, ReasonKind
from dvr_jax.search.status import PlanStatus

SCENE = Scene(
    (
        SceneObject("a", "box", (0.06, 0.1, 0.1), (-0.4, 0.3), 6.0),
        SceneObject("b", "cylinder", (0.03, 0.08), (0.3, 0.3), 0.5),
        SceneObject("c", "box", (0.1, 0.1, 0.05), (0.0, -0.5), 0.0),
    ),
    OnRegion("a", Region((0.0, 0.0), 0.2, (0.2, 0.2))),
)
ACTIONS = tuple(
    map(
        Action.parse,
        (
            "grasp(left, +x, a)",
            "grasp(right, -x, b)",
            "place(right, b, table)",
            "place(left, a, goal)",
        ),
    )
)
SECONDS = {"path": 1 / 3, "total": 0.7123456}


def make_plan(
    poses: dict[str, tuple[float, float, float]],
    actions: tuple[Action, ...] = ACTIONS,
    scene: Scene = SCENE,
) -> Plan:
    """A solved plan at whose end objects have these positions [m] and yaws [rad]."""
    samples = 10 * len(actions) + 1
    qpos = np.tile(home_qpos(scene), (samples, 1))
    for item, columns in zip(scene.objects, qpos_layout(scene).objects, strict=True):
        if item.name in poses:
            x, y, yaw = poses[item.name]
            # A pose that is off the support by a little and tilted by a little, as a solver leaves it.
            tilt = 1e-4
            qpos[-1, columns] = [
                x,
                y,
                item.height / 2 + 1e-4,
                math.cos(yaw / 2),
                tilt,
                tilt,
                math.sin(yaw / 2),
            ]
    motion = make_motion(np.arange(samples) * 0.1, qpos, 10 * np.arange(1, len(actions) + 1))
    return Plan(
        scene=scene,
        status=PlanStatus.SOLVED,
        actions=actions,
        motion=motion,
        report=CheckReport(True, (), 1e-4, samples, float(motion.time[-1] - motion.time[0])),
        path=PathQuality("optimal", 0.1, 0.01, 1e-3, 40),
        violations={"position": 1e-4 / 3},
        seconds=SECONDS,
        nlps={"path": 1},
        verdicts={"pose": 12, "path": 1},
        rejected=0,
        options={"search": "mbts", "k_max": 6, "seed": 0, "network": None, "time_limit": 300.0},
    )


SOLVED = make_plan({"a": (0.0, 0.0, 0.3), "b": (0.2, 0.4, -1.0)})
UNSOLVED = replace(
    SOLVED,
    options={**SOLVED.options, "shortest": True},
    reason=Reason(ReasonKind.WIDTH, "", ("a",), 0.02, "'a' is 10 x 12 cm; the gripper opens 8 cm."),
    refuted=(
        Refutation(
            (Action.parse("grasp(left, +x, a)"),),
            "pose",
            Reason(ReasonKind.SIZE, "grasp(left, +x, a)", ("a",), math.nan, "It is too small."),
        ),
    ),
    status=PlanStatus.TIME_LIMIT,
    actions=(),
    motion=None,
    report=None,
    path=None,
    violations={},
)


def test_a_plan_is_one_line() -> None:
    assert repr(SOLVED) == "Plan(solved, 4 actions, a motion of 4.0 s, planned in 0.71 s)"
    assert repr(UNSOLVED) == "Plan(time limit, planned in 0.71 s)"


def test_the_status_is_its_text() -> None:
    assert SOLVED.status == "solved" and f"{UNSOLVED.status}" == "time limit"
    assert SOLVED.solved and not UNSOLVED.solved


@pytest.mark.parametrize("saved", [SOLVED, UNSOLVED], ids=["solved", "unsolved"])
def test_a_saved_plan_is_read_back(saved: Plan, tmp_path: Path) -> None:
    saved.save(tmp_path / "new" / "plan", pictures=False, animation=False)
    loaded = Plan.load(str(tmp_path / "new" / "plan"))
    assert loaded == saved
    assert isinstance(loaded.status, PlanStatus)
    record = json.loads((tmp_path / "new" / "plan" / "plan.json").read_text())
    assert record["status"] == str(saved.status)
    assert record["action_descriptions"] == list(saved.action_descriptions)


def test_plans_that_differ_are_not_equal() -> None:
    assert SOLVED != UNSOLVED and SOLVED != "solved"
    assert replace(SOLVED, rejected=1) != SOLVED
    assert SOLVED.motion is not None
    other = replace(SOLVED.motion, qpos=SOLVED.motion.qpos + 1e-12)
    assert replace(SOLVED, motion=other) != SOLVED


def test_pictures_and_animation_are_optional(tmp_path: Path) -> None:
    names = {}
    for pictures, animation in ((False, False), (True, False), (False, True)):
        SOLVED.save(tmp_path, pictures, animation)
        names[pictures, animation] = {path.name for path in tmp_path.iterdir()}
    always = {"plan.json", "trajectory.npz", "scene.xml"}
    assert names == {
        (False, False): always,
        (True, False): always | {"film.png", "depth.png"},
        (False, True): always | {"plan.gif"},
    }


def _without_checksum(folder: Path) -> dict[str, Any]:
    """The content of plan.json as it was before version 0.10; an edited one has another checksum."""
    record: dict[str, Any] = json.loads((folder / "plan.json").read_text())
    del record["checksum"]
    return record


def _edit(**changes: object) -> Callable[[Path], None]:
    """A change of plan.json."""

    def edit(folder: Path) -> None:
        record = _without_checksum(folder)
        (folder / "plan.json").write_text(json.dumps(record | changes))

    return edit


def _cut(folder: Path) -> None:
    content = (folder / "plan.json").read_bytes()
    (folder / "plan.json").write_bytes(content[: len(content) // 2])


def _drop(folder: Path) -> None:
    record = _without_checksum(folder)
    del record["status"]
    (folder / "plan.json").write_text(json.dumps(record))


def _other_motion(folder: Path) -> None:
    motion = load_motion(folder / "trajectory.npz")
    save_motion(folder / "trajectory.npz", replace(motion, qpos=motion.qpos[:, :-7]))


def _other_switches(folder: Path) -> None:
    motion = load_motion(folder / "trajectory.npz")
    save_motion(folder / "trajectory.npz", replace(motion, switch=motion.switch[:-1]))


GRASP = {"operator": "grasp", "arguments": ["left", "+x", "a"]}

BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "no plan": (lambda folder: (folder / "plan.json").unlink(), "there is no file "),
    "half a file": (_cut, "holds no plan of this version: Input data was truncated"),
    "no status": (_drop, "missing required field `status`"),
    "an unknown status": (_edit(status="done"), "Invalid enum value 'done'"),
    "a broken scene": (_edit(scene={"version": 1}), "missing required field `objects`"),
    "an unsolved plan with actions": (
        _edit(status="time limit"),
        "has actions or a check, but its status is",
    ),
    "a plan without a check": (_edit(check=None), "not that it passed the check"),
    "other actions": (_edit(actions=[GRASP] * 4), "do not solve its scene: action 2 of 4"),
    "an unknown operator": (
        _edit(actions=[GRASP | {"operator": "throw"}] * 4),
        "there is no operator 'throw'",
    ),
    "no trajectory": (
        lambda folder: (folder / "trajectory.npz").unlink(),
        "says that the plan is solved, but there",
    ),
    "a broken trajectory": (
        lambda folder: (folder / "trajectory.npz").write_text("x"),
        "trajectory.npz",
    ),
    "a trajectory of another scene": (_other_motion, "have 32 numbers; the plan's scene has 39."),
    "a trajectory of other actions": (_other_switches, "has 3 switches; the plan has 4 actions."),
}


@pytest.mark.parametrize("broken", BROKEN)
def test_broken_files_are_refused_in_one_sentence(broken: str, tmp_path: Path) -> None:
    change, message = BROKEN[broken]
    SOLVED.save(tmp_path, pictures=False, animation=False)
    change(tmp_path)
    with pytest.raises(DvrError) as refused:
        Plan.load(tmp_path)
    said = str(refused.value)
    assert message in said and str(tmp_path) in said
    assert said.endswith(".") and "\n" not in said


def test_a_folder_without_a_plan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="valid is a folder that a plan was saved to"):
        Plan.load(tmp_path / "none")


def test_the_scene_after_a_plan_has_its_objects_where_the_motion_ends() -> None:
    after = SOLVED.scene_after()
    validate_scene(after)
    a, b, c = after.objects
    assert a.position == pytest.approx((0.0, 0.0), abs=1e-12) and a.yaw == pytest.approx(
        0.3, abs=1e-6
    )
    assert b.position == pytest.approx((0.2, 0.4), abs=1e-12) and b.yaw == pytest.approx(
        -1.0, abs=1e-6
    )
    # What the plan does not touch stays to the last bit.
    assert c == SCENE.objects[2]
    assert (after.goal, after.workcell, after.fixed) == (SCENE.goal, SCENE.workcell, SCENE.fixed)


@pytest.mark.parametrize(
    ("poses", "touching"),
    [
        ({"a": (0.0, 0.0, 0.0), "b": (0.058, 0.0, 0.0)}, [(0, 1)]),
        ({"a": (0.0, 0.0, 0.4), "b": (0.0, -0.421, 0.0)}, [(1, 2)]),
        ({"a": (0.079, -0.5, 0.0), "b": (0.02, -0.421, 0.0)}, [(0, 2), (1, 2)]),
        ({"a": (-0.75 + 0.133, 0.0, 0.0), "b": (0.2, 0.4, 0.0)}, []),
        ({"a": (0.0, 0.0, 0.0), "b": (1.0715, 0.9712, 0.0)}, []),
    ],
    ids=[
        "two that moved",
        "one that moved",
        "both at a third",
        "an arm's foot",
        "the table's border",
    ],
)
def test_overlaps_within_the_tolerances_are_resolved(
    poses: dict[str, tuple[float, float, float]], touching: list[tuple[int, int]]
) -> None:
    plan = make_plan(poses)
    after = plan.scene_after()
    validate_scene(after)
    for first, second in touching:
        distance = signed_distance(after.objects[first].footprint, after.objects[second].footprint)
        assert 0 <= distance < 1e-6
    shifts = [
        math.dist(item.position, poses[item.name][:2])
        for item in after.objects
        if item.name in poses
    ]
    assert 0 < max(shifts) < 0.004
    assert after.objects[2] == SCENE.objects[2]


BENCH = FixedBody("bench", "box", (0.3, 0.2, 0.12), (-0.2, 0.0, 0.06), 0.4)
ON_BENCH = Scene(
    (replace(SCENE.objects[0], size=(0.06, 0.08, 0.1)), *SCENE.objects[1:]),
    Goal((On("a", "upper"),)),
    fixed=(BENCH,),
    regions=(Region((-0.2, 0.0), 0.4, (0.3, 0.2), "upper", "bench", Inside.CENTER),),
)
ONTO_BENCH = (ACTIONS[0], Action.parse("place(left, a, upper)"))


def test_an_object_stands_on_the_body_on_which_it_was_placed() -> None:
    after = make_plan({"a": (-0.2, 0.0, 0.4)}, ONTO_BENCH, ON_BENCH).scene_after()
    validate_scene(after)
    assert [item.support for item in after.objects] == ["bench", "table", "table"]
    assert after.center_of(after.objects[0]) == pytest.approx((-0.2, 0.0, 0.17))
    assert after.objects[1:] == ON_BENCH.objects[1:]


@pytest.mark.parametrize(("overhang", "is_valid"), [(0.002, True), (0.02, False)])
def test_a_small_overhang_of_a_bench_is_resolved(overhang: float, is_valid: bool) -> None:
    """The object is 6 cm wide, so its center is 3 cm less the overhang from the side of the bench."""
    away = 0.15 - 0.03 + overhang
    pose = (-0.2 + math.cos(0.4) * away, math.sin(0.4) * away, 0.4)
    plan = make_plan({"a": pose}, ONTO_BENCH, ON_BENCH)
    if not is_valid:
        with pytest.raises(MotionError, match="'a'"):
            plan.scene_after()
        return
    after = plan.scene_after()
    validate_scene(after)
    assert math.dist(after.objects[0].position, pose[:2]) == pytest.approx(overhang, abs=1e-6)


def test_deep_overlaps_are_refused() -> None:
    with pytest.raises(
        MotionError, match="'a' overlaps its surroundings: it would have to move by 0"
    ):
        make_plan({"a": (0.0, 0.0, 0.0), "b": (0.03, 0.0, 0.0)}).scene_after()


def test_an_object_that_is_still_held_is_refused() -> None:
    actions = (ACTIONS[0], ACTIONS[1], ACTIONS[3])
    with pytest.raises(MotionError, match="the right arm still holds 'b' at the end of the plan"):
        make_plan({"a": (0.0, 0.0, 0.0)}, actions).scene_after()


def test_an_unsolved_plan_leaves_no_scene() -> None:
    with pytest.raises(MotionError, match="only a solved plan has a scene after it"):
        UNSOLVED.scene_after()
