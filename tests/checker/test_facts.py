"""The check of the facts of a goal, with motions made by hand, and a user's own fact."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from puppet import Case
from wrong_motions import never_released

from dvr_jax.checker import check_goal, check_motion
from dvr_jax.checker.shapes import Outline
from dvr_jax.checker.supports import covered_depth
from dvr_jax.geometry.footprint import Circle, Rectangle, signed_distance
from dvr_jax.goals import Clear, Goal, HandsEmpty, Holding, Inside, On, Region

TARGET = Region((-0.15, -0.20), 0.2, (0.14, 0.14), "plate")
START = Region((-0.20, 0.20), 0.3, (0.05, 0.08), "start")
BESIDE = Region((-0.15, -0.20), 0.2, (0.06, 0.06), "small")


def found(case: Case, *facts: Any) -> set[str]:
    """Kinds of the findings when the motion has to end with these facts."""
    point = replace(BESIDE, name="point", inside=Inside.CENTER)
    edge = Region((-0.15, -0.29), 0.2, (0.1, 0.08), "edge")
    regions = (replace(TARGET, name="goal"), TARGET, START, BESIDE, point, edge)
    scene = replace(case.scene, goal=Goal(facts), regions=regions)
    return {finding.kind for finding in check_motion(scene, case.actions, case.motion).findings}


def test_what_holds_after_a_box_was_carried_onto_the_plate(carry: Case) -> None:
    assert found(carry, On("yellow", "plate"), HandsEmpty(), Clear("start")) == set()
    assert found(carry, On("yellow", "point")) == set()


def test_what_does_not_hold(carry: Case) -> None:
    assert found(carry, On("yellow", "small")) == {"support overhang"}
    assert found(carry, On("yellow", "start")) == {"support overhang"}
    assert found(carry, On("can", "plate")) == {"support overhang"}
    assert found(carry, Clear("plate")) == {"region covered"}
    assert found(carry, Holding("left", "yellow")) == {"goal not held", "goal off hand"}


def test_what_holds_while_the_box_is_in_the_hand(carry: Case) -> None:
    held = never_released(carry)
    assert found(held, Holding("left", "yellow")) == set()
    assert found(held, Holding("right", "yellow")) == {"goal not held", "goal off hand"}
    assert "goal held" in found(held, On("yellow", "plate"))
    assert found(held, HandsEmpty()) == {"goal held"}


def test_a_part_of_a_region_is_enough_to_cover_it(carry: Case) -> None:
    """The box of 5 x 8 cm at (-0.15, -0.20) reaches 0.5 cm into a region whose near side is 3.5 cm from it."""
    item = carry.scene.objects[0]
    footprint = replace(item, position=TARGET.position, yaw=0.2).footprint
    edge = Region((-0.15, -0.29), 0.2, (0.1, 0.08), "edge")
    depth = -signed_distance(footprint, edge.footprint)
    assert (found(carry, Clear("edge")) == {"region covered"}) is (depth > 2e-3)


def test_covered_depths_are_those_of_exact_footprints() -> None:
    generator = np.random.default_rng(0)
    area = Rectangle((0.1, -0.1), (0.1, 0.06), 0.4)
    overlapping = 0
    for _ in range(300):
        x, y, yaw = (generator.uniform(-1, 1, 3) * (0.3, 0.3, 4.0)).tolist()
        box = Rectangle((x, y), (0.03, 0.08), yaw)
        exact = -signed_distance(box, area)
        depth = covered_depth(Outline(box.corners(), 0.0), area)
        # Diagonals of the box count as directions too, so a depth is at most the exact one.
        assert ((depth > 0) == (exact > 0) and depth <= exact + 1e-12) or exact <= depth <= 0
        disc = Circle((x, y), 0.04)
        round_depth = covered_depth(Outline(np.array([[x, y]]), 0.04), area)
        assert (round_depth > 0) == (signed_distance(disc, area) < 0)
        overlapping += exact > 0
    assert 30 < overlapping < 270


@dataclass(frozen=True, slots=True)
class Touched:
    """A fact of a user's own: the object stands somewhere else than at the start."""

    keyword: ClassVar[str] = "touched"
    object: str

    def conditions(self, world: Any) -> tuple[Any, ...]:
        return ()

    def sentence(self) -> str:
        return f"{self.object} touched"


def test_a_fact_that_the_check_does_not_know_is_refused(carry: Case) -> None:
    with pytest.raises(Exception, match="does not know goals of the type Touched; it knows"):
        found(carry, Touched("yellow"))


def test_a_fact_is_one_function(carry: Case) -> None:
    from dvr_jax.checker.kinds import FindingKind

    kind = FindingKind("not touched", "nothing has moved {0}", "")

    @check_goal.register
    def check_touched(fact: Touched, motion: Any, timeline: Any, log: Any) -> None:
        index = motion.scene.object_index(fact.object)
        shift = np.linalg.norm(np.diff(motion.object_positions[[0, -1], index], axis=0))
        if shift < 1e-3:
            log.add(kind, motion.last_sample, (motion.object_label(index),), 1.0, 0.0)

    assert found(carry, Touched("yellow")) == set()
    assert found(carry, Touched("can")) == {"not touched"}
