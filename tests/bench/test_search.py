"""The comparison of searches on rows made by hand: shares, medians and ratios as counted on paper; its picture."""

from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from dvr_jax.bench import search
from dvr_jax.bench.scene_result import SceneResult
from dvr_jax.bench.scenes import ScenesOptions
from dvr_jax.errors import DvrError


def row(
    scene: int, length: int, total: float, leaf: int = 1, path: int = 1, tried: int = 1
) -> dict[str, Any]:
    """A result; of length 0 it is unsolved."""
    return {
        "scene": scene,
        "words": ["word"] * length,
        "seconds": {"image": 0.1 * total, "network": 0.05 * total, "total": total},
        "nlps": {"path": path, "sequence": 2 * leaf, "pose": 1},
        "verdicts": {"leaf": leaf, "path": tried},
        "status": "solved" if length else "tree exhausted",
        "rejected": 0,
        "passed": length > 0,
    }


ROWS = {
    "dvr": [
        row(0, 2, 0.1),
        row(1, 2, 0.3, leaf=5),
        row(2, 3, 1.0, path=3, tried=2),
        row(3, 0, 9.0),
    ],
    # Scene 1 has a solution of another length, which is no part of the speed-up.
    "mbts": [row(0, 2, 0.2), row(1, 3, 60.0), row(2, 3, 4.0), row(3, 0, 9.0), row(4, 0, 9.0)],
}


@pytest.fixture
def printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> list[str]:
    """The output of the comparison of `ROWS`."""
    seen: list[ScenesOptions] = []

    def plan_scenes(options: ScenesOptions) -> list[SceneResult]:
        seen.append(options)
        return [SceneResult.from_row(row) for row in ROWS[options.search]]

    monkeypatch.setattr(search, "plan_scenes", plan_scenes)
    assert (
        search.run(
            ["--out", str(tmp_path), "--searches", "dvr", "mbts", "--number", "4", "--seed", "7"]
        )
        == 0
    )
    assert [(options.number, options.seed, options.out) for options in seen] == [
        (4, 7, tmp_path / f"{name}.jsonl") for name in ("dvr", "mbts")
    ]
    with Image.open(tmp_path / "search.png") as picture:
        assert picture.width > picture.height > 100
    return capsys.readouterr().out.splitlines()


def test_shares_and_medians(printed: list[str]) -> None:
    head = next(line for line in printed if line.startswith("dvr:"))
    assert (
        head
        == "dvr: 3 solved, 0 of the 3 feasible scenes not; of the time, network 5.0%, its depth image 10.0%"
    )
    two, three = (line.split() for line in printed[printed.index(head) + 2 :][:2])
    # length, scenes, median time, first right, then median and mean of: proposed, paths tried, path NLPs, keyframe NLPs
    assert two == ["2", "2", "0.2", "50%", "3;", "3", "1;", "1", "1;", "1", "7;", "7"]
    assert three == ["3", "1", "1", "100%", "1;", "1", "2;", "2", "3;", "3", "3;", "3"]


def test_the_speed_up_is_over_scenes_with_the_same_length(printed: list[str]) -> None:
    start = printed.index(
        "speed-up of dvr over mbts, scenes where both found the same length: median"
    )
    assert [line.split() for line in printed[start + 1 : -1]] == [
        ["2", "1", "scenes", "2.0x"],
        ["3", "1", "scenes", "4.0x"],
    ]
    assert printed[-1] == "  of 3 solved by both, dvr's solution has more actions in 0, fewer in 1"


def test_scenes_without_a_solution_are_told_of(printed: list[str]) -> None:
    assert [
        line.split() for line in printed if "unsolved" in line and "scenes together" in line
    ] == [
        ["unsolved", "1", "9", "all", "scenes", "together:", "10", "s"],
        ["unsolved", "2", "9", "all", "scenes", "together:", "82", "s"],
    ]


def test_a_comparison_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        DvrError, match="--searches names none; valid are dvr, classifier, mbts, bfs"
    ):
        search.run(["--out", str(tmp_path), "--searches"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"number": 0}, "--number is 0"),
        ({"objects": 9}, "--objects is 9; valid are 1 to 8"),
        ({"cubes": 1.5}, "--cubes is 1.5; valid is 0 to 1"),
        ({"workers": 0}, "--workers is 0"),
        ({"seed": -1}, "--seed is -1"),
        ({"time_limit": 0.0}, "--time-limit is 0"),
        ({"search": "dfs"}, "no search 'dfs'"),
        ({"network": Path("x.npz")}, "--search mbts takes no --network"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        ScenesOptions(**options).check()
