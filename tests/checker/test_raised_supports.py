"""The check of objects that are put on the top of a fixed body, with motions made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from puppet import OPEN, Case, Puppet, hand

from dvr_jax.checker import check_motion
from dvr_jax.goals import Clear, Goal, Inside, On, Region
from dvr_jax.logic import Action
from dvr_jax.scene.types import FixedBody, Scene, SceneObject

HEIGHT = 0.12
BENCH = FixedBody("bench", "box", (0.2, 0.2, HEIGHT), (-0.2, -0.2, HEIGHT / 2), 0.0)
UPPER = Region((-0.2, -0.2), 0.0, (0.14, 0.14), "upper", support="bench")
BOX = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (-0.2, 0.2), 0.0)
ACTIONS = (Action("grasp", ("left", "+x", "yellow")), Action("place", ("left", "yellow", "upper")))


def carried_to(x: float, bottom: float) -> Case:
    """The left arm carries the box to a place on the bench, or above it."""
    scene = Scene((BOX,), Goal((On("yellow", "upper"),)), fixed=(BENCH,), regions=(UPPER,))
    puppet = Puppet(scene)
    above = hand((1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    puppet.reach(0, above, np.array([-0.2, 0.2, 0.16]))
    puppet.reach(0, above, np.array([-0.2, 0.2, 0.07]))
    puppet.fingers(0, 0.025)
    puppet.attach(0, 0)
    puppet.reach(0, above, np.array([-0.2, 0.2, 0.30]))
    puppet.reach(0, above, np.array([x, -0.2, 0.30]))
    puppet.reach(0, above, np.array([x, -0.2, 0.07 + bottom]))
    puppet.release(0)
    puppet.fingers(0, OPEN)
    puppet.reach(0, above, np.array([x, -0.2, 0.30]))
    return Case(scene, ACTIONS, puppet.motion())


def kinds(case: Case) -> set[str]:
    report = check_motion(case.scene, case.actions, case.motion)
    assert report.passed == (not report.findings)
    return {finding.kind for finding in report.findings}


@pytest.fixture(scope="module")
def placed() -> Case:
    return carried_to(-0.2, HEIGHT)


def test_a_box_that_stands_on_the_bench_passes(placed: Case) -> None:
    assert kinds(placed) == set()


def test_a_footprint_off_the_region_is_refused() -> None:
    # The box is 5 cm wide; its outline ends 1.5 cm beyond the region of 14 cm.
    assert kinds(carried_to(-0.14, HEIGHT)) == {"support overhang"}


def test_a_box_in_the_air_is_refused() -> None:
    assert kinds(carried_to(-0.2, HEIGHT + 0.006)) == {"support height"}


def test_the_center_suffices_where_the_region_says_so() -> None:
    case = carried_to(-0.14, HEIGHT)
    region = replace(UPPER, inside=Inside.CENTER)
    assert kinds(replace(case, scene=replace(case.scene, regions=(region,)))) == set()


def test_a_region_below_or_above_is_not_covered(placed: Case) -> None:
    """The box on the bench covers the region on the bench, but not the region on the table at the same place."""

    def end(fact: Clear) -> set[str]:
        ground = replace(UPPER, name="ground", support="table")
        scene = replace(placed.scene, goal=Goal((fact,)), regions=(UPPER, ground))
        return kinds(replace(placed, scene=scene))

    assert end(Clear("ground")) == set()
    assert end(Clear("upper")) == {"region covered"}
