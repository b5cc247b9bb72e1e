"""The table of many plans: rows are whole or absent, failures are tried again, strangers are refused."""

import json
from pathlib import Path

import pytest

from dvr_jax.errors import DataError
from dvr_jax.planning.plan_table import RESULTS, RUN, PlanTable, checksum_of
from dvr_jax.planning.scene_tasks import PlanSettings, ScenePlan

TEXTS = ["{} \n", "{1}", "{2}", "{3}"]
CHECKSUMS = [checksum_of(text) for text in TEXTS]
SETTINGS = PlanSettings(k_max=3)


def open_table(folder: Path) -> PlanTable:
    return PlanTable(folder, SETTINGS, CHECKSUMS)


@pytest.fixture
def begun(tmp_path: Path) -> Path:
    """A folder whose run was stopped after two refused scenes and one failure."""
    table = open_table(tmp_path)
    assert table.missing() == [0, 1, 2, 3]
    table.add(ScenePlan(2, None, "too wide", is_refused=True))
    table.add(ScenePlan(0, None, "the worker\ndied"))
    table.add(ScenePlan(1, None, "too high", is_refused=True))
    return tmp_path


def test_a_run_goes_on_where_it_was(begun: Path) -> None:
    lines = (begun / RESULTS).read_text().splitlines()
    assert [json.loads(line)["status"] for line in lines] == ["refused", "failed", "refused"]
    assert json.loads(lines[1])["reason"] == "the worker died"

    table = open_table(begun)
    assert table.missing() == [0, 3] and sorted(table.rows) == [1, 2]
    assert len((begun / RESULTS).read_text().splitlines()) == 2
    table.sort()
    rows = [json.loads(line) for line in (begun / RESULTS).read_text().splitlines()]
    assert [row["scene"] for row in rows] == [1, 2] and rows == [table.rows[1], table.rows[2]]


@pytest.mark.parametrize("cut", range(1, 40, 7))
def test_a_row_that_was_cut_short_does_not_count(begun: Path, cut: int) -> None:
    whole = (begun / RESULTS).read_bytes()
    (begun / RESULTS).write_bytes(whole[:-cut])
    table = open_table(begun)
    assert table.missing() == [0, 1, 3]
    table.add(ScenePlan(1, None, "too high", is_refused=True))
    rows = [json.loads(line) for line in (begun / RESULTS).read_text().splitlines()]
    assert [row["scene"] for row in rows] == [2, 1]


def test_another_run_is_refused(begun: Path) -> None:
    with pytest.raises(DataError, match=r"holds plans of other settings .* choose another --out"):
        PlanTable(begun, PlanSettings(k_max=4), CHECKSUMS)
    with pytest.raises(DataError, match=r"row 2 of .* is of another scene"):
        PlanTable(begun, SETTINGS, CHECKSUMS[::-1])
    # Scenes that are added at the end of a file are planned, and the rows stay.
    assert PlanTable(begun, SETTINGS, [*CHECKSUMS, "more"]).missing() == [0, 3, 4]

    record = json.loads((begun / RUN).read_text())
    record["versions"]["dvr_jax"] = "0.0.1"
    (begun / RUN).write_text(json.dumps(record))
    with pytest.raises(DataError, match=r"of another version .*0\.0\.1"):
        open_table(begun)


@pytest.mark.parametrize(("name", "content"), [(RUN, "[]"), (RUN, "{"), (RESULTS, "{}\n")])
def test_a_broken_file_is_refused(begun: Path, name: str, content: str) -> None:
    (begun / name).write_text(content)
    with pytest.raises(DataError, match=name.replace(".", r"\.")):
        open_table(begun)
