"""Scenes without a solution get an answer soon, and the answer is about what was searched."""

from collections.abc import Iterator

import jax
import pytest
from relaxation_cases import NO_LIFT, single

from dvr_jax.logic import Action
from dvr_jax.planning import planner
from dvr_jax.planning.planner import plan
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.search import searches
from dvr_jax.search.node import Node
from dvr_jax.search.searches import SPARE_ACTIONS
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone

EASY = single((0.05, 0.05, 0.05), (-0.4, 0.35))
"""Two actions suffice."""


def leaf_of(tree: SequenceTree, actions: tuple[Action, ...]) -> Node:
    """The node of a sequence that reaches the goal."""
    node = tree.root
    for depth in range(1, len(actions) + 1):
        node = Node(actions[:depth], 0, node, reaches_goal=depth == len(actions))
    return node


def test_a_scene_that_is_refuted_by_motions_gets_its_answer_from_few_paths() -> None:
    result = plan(NO_LIFT, "mbts", time_limit=3600)
    assert not result.solved and result.options["k_max"] == 6
    assert result.reason is not None and "yellow" in result.reason.sentence
    # Without motion windows, the paths of more than two hundred sequences fail.
    assert result.verdicts["path"] <= 3


@pytest.mark.parametrize("index", [3, 9])
def test_motions_of_accepted_plans_are_not_refuted(index: int) -> None:
    scene = scene_of_seed(6, index, 2)
    solved = plan(scene, "mbts", termination="feasible", time_limit=3600)
    assert solved.solved and len(solved.actions) >= 4
    with jax.enable_x64(True):
        tree = SequenceTree(scene, 6, seed=1)
        leaf = leaf_of(tree, solved.actions)
        run_alone(tree.judge_motions(leaf))
    assert tree.counts.verdicts["motion"] == len(set(windows_of(solved.actions)))
    assert tree.counts.feasible["motion"] == tree.counts.verdicts["motion"]
    assert not tree.is_motion_refuted(leaf)


def windows_of(actions: tuple[Action, ...]) -> Iterator[tuple[Action | None, Action]]:
    """The pairs of actions that follow each other on one object, if it is held between them or at its start."""
    before: dict[str, Action] = {}
    for action in actions:
        name = action.arguments[2] if action.operator == "grasp" else action.arguments[1]
        last = before.get(name)
        if last is None or last.operator == "grasp":
            yield (last, action)
        before[name] = action


def test_a_plan_says_how_long_longer_sequences_were_searched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(searches, "LONGER_WORK", 0)
    monkeypatch.setattr(planner, "USUAL_K_MAX", 1)
    result = planner.plan(EASY, "mbts")
    assert result.status == PlanStatus.EXHAUSTED
    assert result.options["k_max"] == 1 and result.options["longer_k_max"] == 2 + SPARE_ACTIONS
    assert 0 < result.seconds["longer"] <= result.seconds["total"]
    # With a limit that the caller states there is nothing beyond it.
    stated = planner.plan(EASY, "mbts", k_max=1)
    assert stated.status == PlanStatus.EXHAUSTED and "longer_k_max" not in stated.options
