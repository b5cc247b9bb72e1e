"""Plans with more actions than those of multi-bound search are counted."""

from itertools import islice
from pathlib import Path

import pytest

from dvr_jax.bench.needless import (
    Lengths,
    NeedlessOptions,
    draw_scenes,
    is_longer,
    run,
    table,
)
from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.errors import DvrError


def lengths(dvr: int | None, shortest: int | None, mbts: int | None) -> Lengths:
    return {"dvr": dvr, "dvr, shortest": shortest, "mbts": mbts}


ROWS = [lengths(2, 2, 2), lengths(4, 3, 3), lengths(None, None, None), lengths(None, 5, 5)]


def test_only_plans_of_both_searches_are_compared() -> None:
    assert [is_longer(row, "dvr") for row in ROWS] == [False, True, False, False]
    assert table(ROWS) == [
        "4 scenes, of which mbts solves 3",
        "dvr: 1 of 2 plans have more actions than that of mbts (50.0%); 1 scenes are solved by mbts alone",
        "  scene 1: 4 instead of 3",
        "dvr, shortest: 0 of 3 plans have more actions than that of mbts (0.0%); 0 scenes are solved by mbts alone",
    ]


def test_scenes_have_an_object_on_each_side_if_that_is_asked_for() -> None:
    options = NeedlessOptions(shape="cylinder", sides=True, seed=6)
    scenes = list(islice(draw_scenes(options), 5))
    assert all(
        min(o.position[0] for o in s.objects) < 0 < max(o.position[0] for o in s.objects)
        for s in scenes
    )
    every = list(islice(draw_scenes(NeedlessOptions(shape="cylinder", seed=6)), 25))
    assert [s for s in every if s in scenes] == scenes[: len([s for s in every if s in scenes])]
    assert any(s not in scenes for s in every)


def test_scenes_that_a_file_has_are_not_planned_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rows.jsonl"
    header = {
        "objects": 2,
        "shape": "box",
        "sides": False,
        "seed": 6,
        "k_max": 6,
        "time_limit": 60.0,
    }
    file = ResultsFile(path, header)
    for index, row in enumerate(ROWS):
        file.add({"scene": index, "lengths": row})
    assert run(["--number", "4", "--out", str(path)]) == 0
    assert capsys.readouterr().out.splitlines() == table(ROWS)


def test_options_that_make_no_sense_are_refused() -> None:
    with pytest.raises(DvrError, match="--objects is 1; valid are 2 to 8"):
        NeedlessOptions(objects=1, sides=True).check()
    with pytest.raises(DvrError, match="--k-max is 0; valid is 1 or more"):
        NeedlessOptions(k_max=0).check()
