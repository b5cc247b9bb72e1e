"""Scenes of every workcell, and scenes with fixed bodies, are planned by multi-bound search and checked."""

import math
from dataclasses import replace

import pytest

from dvr_jax.checker.replay import check_motion
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.sampling import SceneDistribution, scene_of_seed
from dvr_jax.scene.types import FixedBody, OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import validate_scene
from dvr_jax.search.status import PlanStatus
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, WORKCELLS

FAST = ("single",)
"""Workcells whose scenes are planned in every run; the others are slow."""

SCENE_NUMBERS = dict.fromkeys(WORKCELLS, 0)
"""Number of the sampled scene of each workcell: one that has a plan."""


def require_checked(found: Plan) -> None:
    assert found.solved and found.motion is not None
    assert found.report is not None and found.report.passed
    assert check_motion(found.scene, found.actions, found.motion).passed


def workcell_parameter(name: str) -> object:
    return pytest.param(name, marks=[] if name in FAST else [pytest.mark.slow])


@pytest.mark.parametrize("name", [workcell_parameter(name) for name in WORKCELLS])
def test_a_scene_of_every_workcell_is_planned(name: str) -> None:
    number = SCENE_NUMBERS[name]
    scene = scene_of_seed(7, number, 2, SceneDistribution(), WORKCELLS[name])
    assert scene.workcell is WORKCELLS[name]
    found = plan(scene, "mbts", k_max=4)
    require_checked(found)
    assert {action.arguments[0] for action in found.actions} <= set(WORKCELLS[name].arm_names)


BOX = SceneObject("box", "box", (0.05, 0.10, 0.10), (-0.35, 0.25), 0.2)
OPEN = Scene((BOX,), OnRegion("box", Region((-0.35, -0.25), 0.2, (0.16, 0.16))))

WALL = FixedBody("wall", "box", (0.30, 0.03, 0.20), (-0.35, 0.0, 0.10), 0.0)
"""Between the box and its region: the straight way is closed."""

BOARD = FixedBody("shelf board", "box", (0.30, 0.30, 0.03), (-0.35, 0.30, 0.45), 0.0)
"""Above the box: it cannot be lifted far."""


@pytest.mark.slow
def test_an_arm_carries_a_box_over_a_wall() -> None:
    scene = replace(OPEN, fixed=(WALL,))
    validate_scene(scene)
    free = plan(OPEN, "mbts", k_max=2)
    require_checked(free)
    walled = plan(scene, "mbts", k_max=2)
    require_checked(walled)

    # The motion of the open scene would run into the wall.
    assert (
        free.motion is not None
        and free.motion.qpos.shape[1] == DEFAULT_WORKCELL.number_of_joints + 4 + 7
    )
    report = check_motion(scene, free.actions, free.motion)
    assert any("fixed/wall" in finding.names for finding in report.findings)


@pytest.mark.slow
def test_an_arm_takes_a_box_from_below_a_shelf_board() -> None:
    scene = replace(OPEN, fixed=(BOARD, WALL))
    validate_scene(scene)
    require_checked(plan(scene, "mbts", k_max=2))


@pytest.mark.slow
def test_a_board_low_over_the_region_is_avoided_or_exhausts_the_tree() -> None:
    """The board leaves 6 cm above a part of the region; the box is 5 cm wide, 10 cm long and 10 cm high."""
    x, y = OPEN.goal.region.position
    yaw = OPEN.goal.region.yaw

    def with_board(uncovered: float) -> Scene:
        """The scene with a board that leaves a strip of so many meters along one side of the region."""
        shift = 0.15 - 0.08 + uncovered
        position = (x - shift * math.sin(yaw), y + shift * math.cos(yaw), 0.075)
        board = FixedBody("low board", "box", (0.30, 0.30, 0.03), position, yaw)
        scene = replace(OPEN, fixed=(board,))
        validate_scene(scene)
        return scene

    require_checked(plan(with_board(0.10), "mbts", k_max=2))
    assert plan(with_board(0.03), "mbts", k_max=2).status is PlanStatus.EXHAUSTED
