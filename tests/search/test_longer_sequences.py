"""Where no limit is stated, longer sequences are searched with a limited effort, and the answer says so."""

import jax
import pytest
from relaxation_cases import single

from dvr_jax.search import searches
from dvr_jax.search.searches import SPARE_ACTIONS, search
from dvr_jax.search.session import Outcome
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree

EASY = single((0.05, 0.05, 0.05), (-0.4, 0.35))
"""Two actions suffice."""


def search_from_one_action() -> tuple[SequenceTree, Outcome]:
    """Search for one action, which never suffices, and then for more."""
    with jax.enable_x64(True):
        tree = SequenceTree(EASY, k_max=1)
        found = search(
            "mbts", tree, lambda *_: True, lambda _: None, is_limit_open=True, shortest=False
        )
    return tree, found


def test_longer_sequences_are_found() -> None:
    tree, found = search_from_one_action()
    assert found.status == PlanStatus.SOLVED and found.node is not None and found.node.depth == 2
    assert found.longer is None and tree.k_max == 2 + SPARE_ACTIONS


def test_the_answer_is_about_what_was_searched_completely(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searches, "LONGER_WORK", 0)
    tree, found = search_from_one_action()
    assert found.status == PlanStatus.EXHAUSTED and tree.k_max == 1
    assert found.longer is not None and found.longer.k_max == 2 + SPARE_ACTIONS
