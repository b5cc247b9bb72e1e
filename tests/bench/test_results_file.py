"""Results are kept, a line that was cut short is dropped, and files of other options are refused."""

import json
from pathlib import Path

import pytest

from dvr_jax.bench import results_file
from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.errors import DvrError


def test_rows_are_there_again_and_a_cut_line_is_not(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    first = ResultsFile(path, {"seed": 1, "k": (1, 2)})
    for scene in range(3):
        first.add({"scene": scene, "words": ["a"] * scene})
    path.write_text(path.read_text()[:-5])
    again = ResultsFile(path, {"seed": 1, "k": (1, 2)})
    assert again.rows == {0: {"scene": 0, "words": []}, 1: {"scene": 1, "words": ["a"]}}
    again.add({"scene": 2, "words": []})
    assert sorted(ResultsFile(path, {"seed": 1, "k": (1, 2)}).rows) == [0, 1, 2]


def test_other_options_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    ResultsFile(path, {"seed": 1})
    with pytest.raises(DvrError, match="other options"):
        ResultsFile(path, {"seed": 2})
    path.write_text("not JSON\n")
    with pytest.raises(DvrError, match="no results of a benchmark"):
        ResultsFile(path, {"seed": 1})


def test_without_a_file_rows_are_kept_in_memory() -> None:
    in_memory = ResultsFile(None, {})
    in_memory.add({"scene": 7})
    assert in_memory.rows == {7: {"scene": 7}}


def test_results_of_another_version_are_shown_but_not_mixed_with_new_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rows.jsonl"
    ResultsFile(path, {}, of="label").add({"label": 1})
    assert ResultsFile(path, {}, of="label").missing(3) == [0, 2]
    assert "1 of 3 labels" in capsys.readouterr().err
    monkeypatch.setattr(results_file, "__version__", "9.9")
    assert ResultsFile(path, {}, of="label").missing(0) == []
    with pytest.raises(DvrError, match=r"results of dvr_jax .*, this is 9\.9"):
        ResultsFile(path, {}, of="label").missing(3)


def test_facts_are_added_to_a_header_that_lacks_them(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    ResultsFile(path, {"seed": 1}).add({"scene": 0})
    assert ResultsFile(path, {"seed": 1}, facts={"totals": {"a": 3}}).rows == {0: {"scene": 0}}
    assert json.loads(path.read_text().splitlines()[0])["totals"] == {"a": 3}
    assert ResultsFile(path, {"seed": 1}).rows == {0: {"scene": 0}}
