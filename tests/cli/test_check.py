"""The command `dvr-jax check`: exit codes, and what it prints."""

from dataclasses import replace
from pathlib import Path

import pytest
from puppet import Case, carried_box
from puppet_plans import plan_of

from dvr_jax.cli import check
from dvr_jax.errors import DataError
from dvr_jax.motion.motion import Motion


@pytest.fixture(scope="module")
def case() -> Case:
    return carried_box()


def save(case: Case, motion: Motion | None, folder: Path) -> str:
    plan_of(case, motion).save(folder, pictures=False, animation=False)
    return str(folder)


@pytest.mark.parametrize("options", [[], ["--dynamics"]])
def test_a_clean_motion_passes(
    case: Case, options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.main([save(case, case.motion, tmp_path), *options]) == check.EXIT_PASSED
    assert capsys.readouterr().out.startswith("check passed: ")


def test_findings_are_listed(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fast = replace(case.motion, time=case.motion.time / 8)
    folder = save(case, fast, tmp_path)
    assert check.main([folder]) == check.EXIT_FAILED
    printed = capsys.readouterr().out
    assert printed.startswith("check failed") and "left/joint" in printed
    assert "torque" not in printed

    assert check.main([folder, "--dynamics"]) == check.EXIT_FAILED
    assert "needs a torque of" in capsys.readouterr().out


def test_a_plan_without_a_motion_is_refused(case: Case, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not solved, so that it has no motion"):
        check.main([save(case, None, tmp_path)])
