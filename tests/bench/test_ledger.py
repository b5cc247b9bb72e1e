"""Results are kept, a line that was cut short is dropped, and files of other options are refused."""

from pathlib import Path

import pytest

from dvr_jax.bench.ledger import Ledger
from dvr_jax.errors import DvrError


def test_rows_are_there_again_and_a_cut_line_is_not(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    first = Ledger(path, {"seed": 1, "k": (1, 2)})
    for scene in range(3):
        first.add({"scene": scene, "words": ["a"] * scene})
    path.write_text(path.read_text()[:-5])
    again = Ledger(path, {"seed": 1, "k": (1, 2)})
    assert again.rows == {0: {"scene": 0, "words": []}, 1: {"scene": 1, "words": ["a"]}}
    again.add({"scene": 2, "words": []})
    assert sorted(Ledger(path, {"seed": 1, "k": (1, 2)}).rows) == [0, 1, 2]


def test_other_options_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    Ledger(path, {"seed": 1})
    with pytest.raises(DvrError, match="other options"):
        Ledger(path, {"seed": 2})
    path.write_text("not JSON\n")
    with pytest.raises(DvrError, match="no results of a benchmark"):
        Ledger(path, {"seed": 1})


def test_without_a_file_rows_are_kept_in_memory() -> None:
    ledger = Ledger(None, {})
    ledger.add({"scene": 7})
    assert ledger.rows == {7: {"scene": 7}}
