"""Times until the answer for unsolvable scenes, and the comparison with earlier results."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.bench.scene_result import SceneResult
from dvr_jax.bench.scenes import header_options
from dvr_jax.bench.unsolvable import (
    UnsolvableOptions,
    compare,
    describe,
    percentile,
    read_before,
    run,
    scenes_options,
)
from dvr_jax.errors import DvrError

OPTIONS = UnsolvableOptions(number=4, seed=3, search="mbts", time_limit=20.0)


def result(scene: int, length: int, seconds: float, status: str = "tree exhausted") -> SceneResult:
    """A result without details."""
    return SceneResult(
        scene=scene,
        status="solved" if length else status,
        action_descriptions=("left grasps a",) * length,
        seconds={"total": seconds},
        nlps={},
        verdicts={},
        rejected=0,
        passed=length > 0,
    )


RESULTS = [result(0, 2, 0.5), result(1, 0, 0.1), result(2, 0, 1.4), result(3, 6, 1.0)]


def write(path: Path, options: UnsolvableOptions, results: list[SceneResult]) -> Path:
    file = ResultsFile(path, header_options(scenes_options(options)))
    for each in results:
        file.add(each.to_row())
    return path


def test_the_percentile_is_the_least_number_that_enough_do_not_exceed() -> None:
    numbers = [float(number) for number in range(1, 101)]
    assert percentile(numbers, 0.95) == 95 and percentile(numbers, 1.0) == 100
    assert percentile([3.0], 0.5) == 3.0


def test_times_are_those_of_scenes_without_a_solution() -> None:
    text = "\n".join(describe(RESULTS, 6, 20.0))
    assert "4 scenes, at most 6 actions and 20 s each: 3.0 s in all" in text
    assert "without a solution: 2, of which 0 at the time limit" in text
    assert "median 0.75, 95 % within 1.40, at most 1.40; 50% of all time" in text
    assert "scenes 2 (1.40 s), 1 (0.10 s)" in text


def test_every_difference_is_listed() -> None:
    before = [
        replace(RESULTS[0], seconds={"total": 1.0}),
        replace(RESULTS[1], status="time limit"),
        RESULTS[2],
        result(3, 5, 1.0),
    ]
    lines = compare(before, RESULTS)
    assert lines[0] == "compared with earlier results: 4 scenes"
    assert lines[2:] == [
        "scenes with another status or number of actions: 2",
        "  scene 1: time limit before, tree exhausted now",
        "  scene 3: solved (5 actions) before, solved (6 actions) now",
    ]


def test_only_results_of_equal_limits_are_compared(tmp_path: Path) -> None:
    wanted = header_options(scenes_options(OPTIONS))
    same = write(tmp_path / "same.jsonl", OPTIONS, RESULTS)
    assert read_before(same, wanted) == [SceneResult.from_row(each.to_row()) for each in RESULTS]
    other = write(tmp_path / "other.jsonl", replace(OPTIONS, time_limit=60.0), RESULTS)
    with pytest.raises(
        DvrError, match=r"--time-limit 60\.0, and this benchmark has --time-limit 20"
    ):
        read_before(other, wanted)
    (tmp_path / "text.jsonl").write_text("no results\n")
    with pytest.raises(DvrError, match="holds no results"):
        read_before(tmp_path / "text.jsonl", wanted)
    with pytest.raises(DvrError, match="cannot be read"):
        read_before(tmp_path / "missing.jsonl", wanted)


def test_scenes_that_a_file_has_are_not_planned_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "new.jsonl", OPTIONS, RESULTS)
    before = write(tmp_path / "old.jsonl", OPTIONS, RESULTS)
    header = json.loads(before.read_text().splitlines()[0])
    header["versions"]["dvr_jax"] = "0.8.1"
    before.write_text("\n".join([json.dumps(header), *before.read_text().splitlines()[1:]]) + "\n")
    arguments = ["--number", "4", "--seed", "3", "--search", "mbts", "--time-limit", "20"]
    assert run([*arguments, "--out", str(path), "--before", str(before)]) == 0
    assert "scenes with another status or number of actions: 0" in capsys.readouterr().out
