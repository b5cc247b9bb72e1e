"""The command `python -m dvr_jax.execute`, on plans made by hand."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from PIL import Image
from puppet import Case, carried_box
from puppet_plans import plan_of, with_closed_fingers

from dvr_jax.cli import execute
from dvr_jax.errors import DataError, OptionError
from dvr_jax.execution import Execution, ExecutionConditions, mjx_batch
from dvr_jax.execution import execute as run
from dvr_jax.execution.repetition import ConditionRange
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.types import Scene


def save(folder: Path, case: Case, motion: Motion | None) -> None:
    plan_of(case, motion).save(folder, pictures=False, animation=False)


@pytest.fixture(scope="module")
def case() -> Case:
    return carried_box()


def test_a_success(tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path, case, case.motion)
    assert execute.main([str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("the goal holds after ")
    assert [line.split(":")[0].strip() for line in lines[1:3]] == ["yellow", "can"]
    assert lines[3] == f"animation: {tmp_path / 'execution.gif'}"
    with Image.open(tmp_path / "execution.gif") as animation:
        assert animation.n_frames > 10


def test_a_failure(tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path, case, with_closed_fingers(case))
    assert execute.main([str(tmp_path), "--no-animation"]) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("the goal does not hold after ")
    assert "yellow was pushed before its grasp (touched by left/finger_" in printed
    assert not (tmp_path / "execution.gif").exists()


def test_repetitions(tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path, case, case.motion)
    options = ["--repeat", "3", "--object-noise", "1", "--friction", "0.6", "1.2", "--workers", "2"]
    assert execute.main([str(tmp_path), *options]) == 0
    assert capsys.readouterr().out == "the goal holds after 3 of 3 executions\n"


def test_the_backend_mjx_runs_all_executions_in_one_call(
    tmp_path: Path, case: Case, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo C stands in for MJX, which would compile for half a minute; `tests/execution` compares the two."""
    batches: list[list[ExecutionConditions]] = []

    def execute_batch(
        scene: Scene,
        actions: Sequence[Action],
        motion: Motion,
        conditions: list[ExecutionConditions],
        report_progress: Callable[[str], None],
    ) -> list[Execution]:
        batches.append(conditions)
        report_progress(f"{len(conditions)} copies")
        return [run(scene, actions, motion, each) for each in conditions]

    monkeypatch.setattr(mjx_batch, "execute_batch", execute_batch)
    save(tmp_path, case, case.motion)
    assert execute.main([str(tmp_path), "--backend", "mjx", "--no-animation", "--seed", "3"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("the goal holds after ")
    assert printed.err == "  1 copies\n"

    options = ["--backend", "mjx", "--repeat", "2", "--friction", "0.6", "1.2", "--seed", "3"]
    assert execute.main([str(tmp_path), *options]) == 0
    printed = capsys.readouterr()
    assert printed.out == "the goal holds after 2 of 2 executions\n"
    assert printed.err.startswith("  2 copies\n  execution 0: the goal holds\n")

    # The conditions are those of MuJoCo C for this seed.
    variation = ConditionRange(0.0, (0.6, 1.2), 3)
    assert batches[1] == [variation.conditions(index) for index in range(2)]
    assert len(batches) == 2


def test_the_backend_mjx_refuses_cylinders(tmp_path: Path, case: Case) -> None:
    save(tmp_path, case, case.motion)
    for options in ([], ["--repeat", "2"]):
        with pytest.raises(OptionError, match="cannot simulate the cylinder 'object/can'"):
            execute.main([str(tmp_path), "--backend", "mjx", *options])


def test_refusals(tmp_path: Path, case: Case) -> None:
    with pytest.raises(DataError, match="valid is a folder that a plan was saved to"):
        execute.main([str(tmp_path)])
    save(tmp_path, case, case.motion)
    for options, message in (
        (["--repeat", "0"], "--repeat is 0; valid is 1 to 10,000,000."),
        (["--friction", "1.2", "0.6"], "the friction is 1.2 to 0.6; valid is the smaller number"),
        (["--friction", "-1", "1"], "the friction is -.*; valid is 0 to 10."),
        (["--object-noise", "200"], "the object noise is 0.2 m; valid is 0 to 0.1 m."),
        (["--repeat", "2", "--out", "x.gif"], "--out names an animation, and repeated"),
    ):
        with pytest.raises(OptionError, match=message):
            execute.main([str(tmp_path), *options])
    save(tmp_path, case, None)
    with pytest.raises(DataError, match="is not solved, so that it has no motion"):
        execute.main([str(tmp_path)])
