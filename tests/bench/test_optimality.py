"""The benchmark of optimality on one problem, and its comparison of two costs."""

import json
import math
from pathlib import Path

import pytest

from dvr_jax.bench.optimality import Comparison, run


def _comparison(cost: float, reference: float) -> Comparison:
    return Comparison(2, 0.4, cost, reference, True, 40, False)


@pytest.mark.parametrize(
    ("cost", "reference", "excess"),
    [(0.11, 0.1, 0.1), (0.1, 0.1, 0.0), (0.09, 0.1, 0.0), (0.1, math.inf, 0.0)],
)
def test_a_cost_is_compared_with_the_better_one(
    cost: float, reference: float, excess: float
) -> None:
    assert _comparison(cost, reference).excess == pytest.approx(excess)


def test_one_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "optimality.json"
    assert run(["--number", "1", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "problem 0, 2 actions: cost " in printed
    assert "all: 1 paths, " in printed

    metrics = {item["metric"]: item["value"] for item in json.loads(out.read_text())["metrics"]}
    assert metrics["within 5% of the reference"] in (0.0, 100.0)
    assert 0 < metrics["cost beside the first feasible path"] <= 100
