"""Labels that contradict themselves, each other or the scene are refused by name."""

from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import list_shards, write_shard
from dvr_jax.errors import DvrError

SCENES, _ = synthetic(3, 4)
NAME = SCENES[3].goal.object
GRASP, PLACE = f"grasp(left, +x, {NAME})", f"place(left, {NAME}, goal)"
SOLUTION = Label(3, (GRASP, PLACE), True, False, "", 0.5)
FAILURE = Label(3, (GRASP, PLACE), False, False, "path", 7.0)
PREFIX = Label(3, (GRASP,), False, True, "pose", nan)


def test_valid_ones_are_taken(tmp_path: Path) -> None:
    for number, labels in enumerate(([SOLUTION], [FAILURE], [PREFIX], [PREFIX, FAILURE], [])):
        assert write_shard(
            tmp_path / f"{number}.parquet", SCENES, labels, OPTIONS
        ).footer.labels == len(labels)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([replace(SOLUTION, bound="path")], "is feasible, yet refuted by 'path'"),
        ([replace(SOLUTION, refuted_prefix=True)], "is feasible, yet refuted by 'its prefix'"),
        ([replace(FAILURE, bound="")], "by the bound ''; valid are symbolic, pose"),
        ([replace(FAILURE, violation=-1.0)], "violation -1.0; valid is 0 or more"),
        ([replace(PREFIX, refuted_prefix=False)], "does not reach the goal"),
        ([replace(SOLUTION, actions=(PLACE,))], "is not applicable, because holding"),
        ([replace(SOLUTION, actions=(GRASP, PLACE, GRASP))], "the goal holds after 2 of 3 actions"),
        ([replace(SOLUTION, actions=("push(left, red)",))], "no action 'push"),
        ([replace(SOLUTION, scene=4)], "in scene 4 is of no scene of the shard; valid are 3 to 3"),
        ([SOLUTION, FAILURE], "is there twice"),
        ([SOLUTION, PREFIX], "is feasible, but its first 1 actions are stored as a refuted prefix"),
        ([SOLUTION, replace(PREFIX, actions=())], "is feasible, but its first 0 actions"),
    ],
)
def test_contradictions_are_refused(labels: list[Label], message: str, tmp_path: Path) -> None:
    with pytest.raises(DvrError, match=message.replace("(", r"\(")):
        write_shard(tmp_path / "a.parquet", SCENES, labels, OPTIONS)
    assert list_shards(tmp_path) == []
