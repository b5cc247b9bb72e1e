"""Chains of goals: the goals that are drawn, and a short chain."""

import numpy as np
import pytest

from dvr_jax.bench.chains import MOST_ON_REGION, ChainsOptions, follow_chain, next_goal
from dvr_jax.errors import DvrError


def test_every_new_goal_changes_the_region_of_one_object() -> None:
    generator = np.random.default_rng(0)
    wanted: dict[str, str] = {}
    for _ in range(200):
        new = next_goal(generator, wanted)
        changed = [name for name in new if new[name] != wanted.get(name)]
        assert len(changed) == 1
        assert max(list(new.values()).count(region) for region in new.values()) <= MOST_ON_REGION
        wanted = new
    assert len(wanted) == 3


def test_bad_options_are_refused() -> None:
    with pytest.raises(DvrError, match="--number is 0"):
        ChainsOptions(number=0).check()
    with pytest.raises(DvrError, match="no search 'astar'"):
        ChainsOptions(search="astar").check()


@pytest.mark.slow
def test_a_short_chain_undoes_no_goal() -> None:
    figures = follow_chain(ChainsOptions(number=5, time_limit=600.0))
    assert figures.solved == 5
    assert figures.refused == 0
    assert figures.undone == 0
