"""The tables of the comparison with `robotic`, from rows made by hand."""

from typing import Any

import pytest

from dvr_jax.bench.peer_statistics import COMPARISONS, compare_sides, describe_costs
from dvr_jax.bench.peer_tables import FINER, print_tables


def side(feasible: bool, seconds: float, passed: bool = False, **measure: float) -> dict[str, Any]:
    row = {"feasible": feasible, "seconds": seconds, "passed": passed}
    return {**row, "cost": 1.0, "our measure": {"ratio": 2.0, "ratio at slices": 2.0, **measure}}


def problem(ours: dict[str, Any], theirs: dict[str, Any], paths: dict[str, Any]) -> dict[str, Any]:
    return {
        "length": 2,
        "source": "found",
        "keyframes": {"ours": ours, "robotic": theirs},
        "path": paths,
    }


def test_medians_are_of_problems_on_which_both_agree(capsys: pytest.CaptureFixture[str]) -> None:
    paths = {"ours": side(True, 0.02, passed=True), "ours at slices": side(True, 0.01)}
    theirs = {"robotic": side(True, 0.2, ratio=0.5), "robotic finer": side(False, 1.0)}
    rows = [
        problem(side(True, 0.002), side(True, 0.010, ratio=1.0), {**paths, **theirs}),
        problem(side(True, 0.004), side(True, 0.040), {}),
        problem(side(True, 0.006), side(True, 0.100), {}),
        problem(side(True, 9.0), side(False, 9.0), {}),
        problem(side(False, 0.5), side(False, 1.0), {}),
    ]
    print_tables(rows)
    tables = capsys.readouterr().out.split("\n\n")[1:]
    assert [table.splitlines()[0] for table in tables] == [
        comparison.title for comparison in COMPARISONS
    ]
    last = [table.splitlines()[-1].split() for table in tables]
    assert all(line[0] == "all" for line in last)
    cells = [[cell.split() for cell in " ".join(line[1:]).split("|")] for line in last]
    # Number, feasible for both, ours only, robotic's only, neither; medians [ms] and their ratio.
    assert cells[0] == [
        ["5", "3", "1", "0", "1"],
        ["4", "40", "10.0"],
        ["500", "1000", "2.0"],
        ["1", "of", "3"],
    ]
    assert cells[1][:2] == [["1", "1", "0", "0", "0"], ["10", "200", "20.0"]]
    assert cells[1][3:6] == [["1", "0", "of", "1"], ["0", "of", "1"], ["0", "of", "1"]]
    assert cells[2][1] == ["20", "200", "10.0"] and cells[2][4] == ["1", "of", "1"]
    assert cells[3][:2] == [["1", "0", "1", "0", "0"], ["-", "-", "-"]]


def test_costs_are_compared_where_both_paths_pass_the_check() -> None:
    pairs = [(1.0, 2.0, True), (2.02, 2.0, True), (3.0, 2.0, True), (9.0, 1.0, False)]
    rows = [
        problem(
            side(True, 1.0),
            side(True, 1.0),
            {
                "ours optimal": side(True, 1.0, passed=True) | {"cost": ours},
                "robotic": side(True, 1.0, passed=passed) | {"cost": theirs},
            },
        )
        for ours, theirs, passed in pairs
    ]
    sides = compare_sides(rows, "path", "ours optimal", "robotic")
    assert sides.cost_ratios == (0.5, 1.01, 1.5)
    assert describe_costs(sides.cost_ratios) == "2 of 3 (1.01)"
    assert describe_costs(()) is None


def test_the_title_of_finer_paths_names_how_fine_they_are() -> None:
    assert f"of {FINER} times the slices" in COMPARISONS[-1].title
