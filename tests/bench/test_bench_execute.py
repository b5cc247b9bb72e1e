"""The benchmark of executions: what a row says, what is printed, and how it goes on where it was stopped."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from puppet import carried_box
from puppet_plans import plan_of, with_closed_fingers

from dvr_jax.bench import execute
from dvr_jax.bench.committed import CommittedResults
from dvr_jax.bench.execute import ExecuteOptions
from dvr_jax.bench.execution_figures import causes, execution
from dvr_jax.errors import OptionError
from dvr_jax.planning.result import Plan


@pytest.fixture
def plans(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """A plan that succeeds, one that fails, and a scene without a plan, in place of what the planner finds."""
    case = carried_box()
    found = [
        plan_of(case, case.motion),
        plan_of(case, with_closed_fingers(case)),
        plan_of(case, None),
    ]
    monkeypatch.setattr(execute, "plan_scene", lambda options, index, termination: found[index])
    return found


def test_rows_and_tables(
    plans: list[Plan], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bench/results/execution/three.jsonl"
    options = ExecuteOptions(number=3, out=file)
    rows = [execute._execute_one(options, index) for index in range(3)]
    assert [row["status"] for row in rows] == ["solved", "solved", "tree exhausted"]
    assert [row["length"] for row in rows] == [2, 2, 0]
    assert [row.get("succeeded") for row in rows] == [True, False, None]
    assert rows[1]["cause"] == "pushed before its grasp"

    # A file that has all rows is not measured again; what is printed comes out of it.
    header = {
        "options": execute.header_options(options),
        "machine": "Abacus",
        "cores": 3,
        "versions": {"dvr_jax": "1.2"},
    }
    file.parent.mkdir(parents=True)
    file.write_text("".join(json.dumps(row) + "\n" for row in [header, *rows]))
    assert execute.run(["--number", "3", "--out", str(file)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].endswith("dvr: 2 solved and executed")
    assert printed[1].split() == ["all", "lengths", "1", "of", "2", "succeed", "(50%)"]
    assert printed[-1] == "  1 failed: pushed before its grasp"

    results = CommittedResults(tmp_path)
    assert "| 3 of 2 boxes, seed 1, `dvr` | friction 1 | 2 | 1 of 2 (50 %) |" in execution(results)
    assert causes(results).splitlines()[-1] == "| pushed before its grasp | 1 |"


def test_wrong_conditions_are_refused_before_anything_is_planned() -> None:
    options = ExecuteOptions(number=1)
    for wrong in (
        replace(options, object_noise=-1.0),
        replace(options, friction=(2.0, 1.0)),
    ):
        with pytest.raises(OptionError):
            list(execute.execute_scenes(wrong))
