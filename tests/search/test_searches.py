"""Both searches on small scenes: they agree, they are repeatable, and they end when the tree is exhausted."""

import math

import pytest

from dvr_jax.planner import Plan, plan
from dvr_jax.scene.types import Goal, Region, Scene, SceneObject

REGION = Region((-0.35, -0.25), 0.2, (0.2, 0.2))


def one_box(x: float, y: float) -> Scene:
    return Scene((SceneObject("a", "box", (0.06, 0.12, 0.1), (x, y), 0.4),), Goal("a", REGION))


@pytest.fixture(scope="module")
def plans() -> dict[str, Plan]:
    """A box that the left arm can bring to its region, by both searches."""
    return {search: plan(one_box(-0.4, 0.3), search, k_max=3, time_limit=300) for search in ("mbts", "bfs")}


def test_both_find_the_shortest_sequence(plans: dict[str, Plan]) -> None:
    for result in plans.values():
        assert result.solved
        assert len(result.actions) == 2
        assert result.report is not None and result.report.passed
        assert all(value <= 0.01 for value in result.violations.values())


def test_the_same_seed_gives_the_same_plan(plans: dict[str, Plan]) -> None:
    again = plan(one_box(-0.4, 0.3), "mbts", k_max=3, time_limit=300)
    first = plans["mbts"]
    assert again.actions == first.actions
    assert again.nlps == first.nlps
    assert again.motion is not None and first.motion is not None
    assert (again.motion.qpos == first.motion.qpos).all()


@pytest.mark.parametrize("search", ["mbts", "bfs"])
def test_what_no_arm_reaches_exhausts_the_tree(search: str) -> None:
    result = plan(one_box(0.0, 0.9), search, k_max=2, time_limit=300)
    assert result.status == "tree exhausted"
    assert not result.actions and result.motion is None


def test_the_deadline_is_kept() -> None:
    result = plan(one_box(-0.4, 0.3), "mbts", k_max=3, time_limit=1e-6)
    assert result.status == "time limit"
    assert math.isclose(sum(result.nlps.values()), 0)
