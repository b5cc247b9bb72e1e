"""Metrics files hold what was measured, where, and by which version."""

import json
from pathlib import Path

import pytest

from dvr_jax import __version__
from dvr_jax.bench import table_one
from dvr_jax.bench.metrics import Direction, Metric, load_metrics, save_metrics
from dvr_jax.bench.recall_metrics import count_pairs
from dvr_jax.errors import DvrError


def test_metrics_are_there_again(tmp_path: Path) -> None:
    metrics = (
        Metric("a", 1.5, "ms", Direction.LOWER, 0.05),
        Metric("b", 3.0, "problems", Direction.HIGHER, 0.0),
    )
    path = tmp_path / "new/speed.json"
    save_metrics(path, "speed", metrics)
    file = load_metrics(path)
    assert (file.benchmark, file.version, file.metrics) == ("speed", __version__, metrics)
    assert file.machine and file.cores >= 1
    assert file.value("b") == 3.0
    with pytest.raises(DvrError, match="have no metric 'c'"):
        file.value("c")
    names = {"metric", "value", "unit", "direction", "tolerance"}
    assert all(set(row) == names for row in json.loads(path.read_text())["metrics"])


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    path.write_text('{"benchmark": "speed"}')
    with pytest.raises(DvrError, match="holds no metrics"):
        load_metrics(path)


def test_table_one_is_the_papers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table1.json"
    assert table_one.run(["--out", str(path)]) == 0
    assert "25 of 25 cells" in capsys.readouterr().out
    assert [metric.value for metric in load_metrics(path).metrics[-2:]] == [47_104, 482_816]


def test_recall_is_of_what_the_oracle_finds() -> None:
    counts = count_pairs([(True, True), (True, False), (False, True), (False, False)])
    assert (counts.problems, counts.oracle, counts.ours, counts.both, counts.recall) == (
        4,
        2,
        2,
        1,
        0.5,
    )
    assert count_pairs([(False, True)]).recall is None
