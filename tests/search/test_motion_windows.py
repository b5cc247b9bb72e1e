"""Windows that have keyframes and no motion: refuted where all paths fail, and never in an accepted plan."""

from collections.abc import Iterator

import jax
import pytest
from relaxation_cases import NO_LIFT, NO_LIFT_ACTIONS

from dvr_jax.logic import Action
from dvr_jax.planning.planner import plan
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.search.explanation import explain_node
from dvr_jax.search.node import Node
from dvr_jax.search.object_graph import UNREACHED
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone


@pytest.fixture
def double_precision() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def leaf_of(tree: SequenceTree, actions: tuple[Action, ...]) -> Node:
    """The node of a sequence that reaches the goal."""
    node = tree.root
    for depth in range(1, len(actions) + 1):
        node = Node(actions[:depth], 0, node, reaches_goal=depth == len(actions))
    return node


@pytest.mark.usefixtures("double_precision")
def test_a_motion_that_no_start_finds_refutes_the_scene() -> None:
    tree = SequenceTree(NO_LIFT, 6)
    session = SearchSession(tree, accept=lambda *_: True, progress=lambda _: None)
    assert run_alone(session.judge_scene())

    # The keyframes of the sequence are feasible, and its path fails from all of them.
    leaf = tree.descend(tuple(map(Action.parse, NO_LIFT_ACTIONS)))
    assert leaf is not None
    run_alone(session.judge_leaves([leaf]))
    assert leaf.feasible and run_alone(session.try_path(leaf)) is None
    run_alone(tree.judge_motions(leaf))
    assert tree.is_motion_refuted(leaf)
    assert not run_alone(session.judge_scene())
    assert tree.relaxation.least_without_limit() == UNREACHED
    reason = explain_node(tree, leaf)
    assert reason is not None and reason.sentence.startswith("Keyframes exist, but no motion.")


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
