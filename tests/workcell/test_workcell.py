"""Workcells: names, bases, and which capsules of two arms can meet."""

import math
from dataclasses import asdict, replace
from itertools import product

import jax
import numpy as np
import pytest

from dvr_jax.errors import DvrError, OptionError
from dvr_jax.workcell.clearances import Clearances
from dvr_jax.workcell.model import workcell_model
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import (
    DEFAULT_WORKCELL,
    LARGEST_ARM_CLEARANCE,
    SINGLE_ARM_WORKCELL,
    WORKCELLS,
    Arm,
    Workcell,
    base_positions,
    base_rotations,
    cross_arm_pairs,
    facing_workcell,
)


def test_the_default_workcell_is_the_papers() -> None:
    assert DEFAULT_WORKCELL == WORKCELLS["facing"] == facing_workcell(1.5)
    assert DEFAULT_WORKCELL.arm_names == ("left", "right")
    np.testing.assert_array_equal(base_positions(DEFAULT_WORKCELL), [[-0.75, 0, 0], [0.75, 0, 0]])
    np.testing.assert_array_equal(
        base_rotations(DEFAULT_WORKCELL), [np.eye(3), np.diag([-1.0, -1.0, 1.0])]
    )
    assert DEFAULT_WORKCELL.home == (PANDA.home, PANDA.home)
    assert (DEFAULT_WORKCELL.number_of_arms, DEFAULT_WORKCELL.number_of_joints) == (2, 14)


@pytest.mark.parametrize("name", WORKCELLS)
def test_arms_are_counted_in_their_order(name: str) -> None:
    workcell = WORKCELLS[name]
    assert [workcell.arm_index(arm) for arm in workcell.arm_names] == list(
        range(workcell.number_of_arms)
    )
    with pytest.raises(DvrError, match=f"no arm 'third'; valid: {', '.join(workcell.arm_names)}"):
        workcell.arm_index("third")


@pytest.mark.parametrize("name", WORKCELLS)
def test_bases_are_upright_rotations(name: str) -> None:
    for R, arm in zip(base_rotations(WORKCELLS[name]), WORKCELLS[name].arms, strict=True):
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(R[:, 0], [math.cos(arm.yaw), math.sin(arm.yaw), 0], atol=1e-12)
        np.testing.assert_array_equal(R[:, 2], [0, 0, 1])


def listed(workcell: Workcell) -> list[tuple[int, int, int, int]]:
    """First arm, second arm, first capsule, second capsule."""
    return [
        (a, b, i, j)
        for a, b, (near, far) in cross_arm_pairs(workcell)
        for i, j in product(range(*near), range(*far))
    ]


@pytest.mark.parametrize("distance", [0.4, 0.8, 1.0, 1.3, 1.5, 1.6, 1.8, 2.0, 3.0])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_pairs_of_two_arms(distance: float, turn: float) -> None:
    """Exactly those whose reaches, grown along the arm, span the distance to within 2 cm; each once, however the arms
    look."""
    arms = (
        Arm("a", (-distance / 2, 0.1), turn),
        Arm("b", (distance / 2, 0.1), 2 * turn),
    )
    pairs = listed(Workcell(arms))
    reach = np.maximum.accumulate(PANDA.capsule_reach)
    number = len(reach)
    expected = {
        (0, 1, i, j)
        for i, j in product(range(number), repeat=2)
        if reach[i] + reach[j] >= distance - 0.02
    }
    assert len(set(pairs)) == len(pairs)
    assert set(pairs) == expected
    # No pair that can come so near by its own reach is left out, and the relation is symmetric.
    own = {
        (0, 1, i, j)
        for i, j in product(range(number), repeat=2)
        if PANDA.capsule_reach[[i, j]].sum() >= distance - 0.02
    }
    assert own <= set(pairs)
    assert {(a, b, j, i) for a, b, i, j in pairs} == set(pairs)


def test_arms_out_of_reach_have_no_pairs() -> None:
    assert cross_arm_pairs(facing_workcell(3.0)) == ()
    assert cross_arm_pairs(SINGLE_ARM_WORKCELL) == ()


def test_models_share_structure_where_arms_can_meet_in_the_same_places() -> None:
    """So that problems share compiled programs: names, homes and small shifts of the bases do not matter."""
    home = (0.1, *PANDA.home[1:])
    moved = Workcell(
        tuple(
            replace(arm, name=f"{arm.name} one", position=(arm.position[0], 0.05), home=home)
            for arm in DEFAULT_WORKCELL.arms
        )
    )
    one, other = workcell_model(DEFAULT_WORKCELL), workcell_model(moved)
    assert one.structure == other.structure and hash(one.structure) == hash(other.structure)
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for ours, theirs in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert workcell_model(WORKCELLS["facing-1.0"]).structure != one.structure
    assert workcell_model(SINGLE_ARM_WORKCELL).structure != one.structure


def test_no_clearance_of_arms_exceeds_the_distance_up_to_which_their_pairs_count() -> None:
    farthest = Clearances().scaled(3.0).arm_to_arm
    assert 0.01 < farthest <= LARGEST_ARM_CLEARANCE == 0.02


def test_clearances_are_scaled_one_and_all() -> None:
    clearances = Clearances(hand_to_object=0.01, lift=0.03)
    once = asdict(clearances)
    half = asdict(clearances.scaled(0.5))
    assert clearances.scaled(1.0) == clearances
    assert half == {name: 0.5 * value for name, value in once.items()}
    assert half["hand_to_object"] == 0.005 and half["lift"] == 0.015
    assert set(asdict(Clearances().scaled(0.0)).values()) == {0.0}


@pytest.mark.parametrize("factor", [-0.1, 3.1, math.nan, math.inf])
def test_a_factor_of_clearances_that_is_none_is_refused(factor: float) -> None:
    with pytest.raises(OptionError, match=rf"^the clearance is {factor:g}; valid is 0 to 3\.$"):
        Clearances().scaled(factor)


def test_clearances_are_numbers_of_a_model_and_no_structure() -> None:
    wide = replace(DEFAULT_WORKCELL, clearances=Clearances(0.011, 0.012, 0.013, 0.014, 0.015))
    one = workcell_model(DEFAULT_WORKCELL)
    other = workcell_model(wide)
    assert one.structure == other.structure
    assert jax.tree.structure(one) == jax.tree.structure(other)
    numbers = []
    for model in (one, other):
        assert model.arm_clearance.shape == ()
        assert model.link_clearance.shape == ()
        assert model.hand_clearance.shape == ()
        numbers.append([model.hand_clearance, model.link_clearance, model.arm_clearance])
    assert numbers == [[0.005, 0.010, 0.006], [0.011, 0.012, 0.013]]
    # Forearm, two of the wrist, flange; then two of the hand and three of either finger.
    np.testing.assert_array_equal(one.table_clearances, [0.010] * 4 + [0.002] * 8)
    np.testing.assert_array_equal(other.table_clearances, [0.014] * 4 + [0.015] * 8)


@pytest.mark.parametrize("name", WORKCELLS)
def test_a_model_is_the_robots_data(name: str) -> None:
    workcell = WORKCELLS[name]
    model = workcell_model(workcell)
    np.testing.assert_array_equal(model.joint_limits, PANDA.joint_limits)
    np.testing.assert_array_equal(model.tucked, PANDA.tucked)
    np.testing.assert_array_equal(model.capsule_radii, PANDA.capsules.radii)
    structure = model.structure
    assert (structure.number_of_arms, structure.joints) == (workcell.number_of_arms, 7)
    assert structure.number_of_joints == workcell.number_of_joints
    assert structure.number_of_capsules == len(PANDA.capsules.names)
    assert structure.cross_pairs == cross_arm_pairs(workcell)
