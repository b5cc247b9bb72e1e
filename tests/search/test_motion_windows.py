"""Windows that have keyframes and no motion are refuted, and with them all sequences that contain them."""

from collections.abc import Iterator

import jax
import pytest
from relaxation_cases import NO_LIFT, NO_LIFT_ACTIONS

from dvr_jax.logic import Action
from dvr_jax.search.explanation import explain_node
from dvr_jax.search.object_graph import UNREACHED
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone


@pytest.fixture
def double_precision() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


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
