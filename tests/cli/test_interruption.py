"""Ctrl-C at any moment of a command: one line, exit code 130, and nothing half done."""

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from synthetic import OPTIONS, synthetic

from dvr_jax.dataset.shards import write_shard
from dvr_jax.model.checkpoint import CheckpointFolder
from dvr_jax.model.history import read_history
from dvr_jax.scene.files import OnRegion, Region, SceneObject, make_scene, save_scene, save_scenes
from dvr_jax.scene.random_scenes import sample_scenes

BUSY = """
import sys
from dvr_jax.runtime.interruption import end_on_interrupt
end_on_interrupt()
import time
{work}
"""
"""A command that is busy with something when it is interrupted."""

WORKERS = """
import os, sys, time
from pathlib import Path
from dvr_jax.runtime import files
from dvr_jax.runtime.interruption import end_on_interrupt
from dvr_jax.runtime.task_pool import run_tasks

def write(number):
    files.os.fsync = lambda descriptor: time.sleep(60)
    files.write_whole(Path(sys.argv[1]) / str(number), b"half")
    yield number

if __name__ == "__main__":
    end_on_interrupt()
    folder = Path(sys.argv[1])
    folder.mkdir()
    import threading
    def tell():
        while len(list(folder.iterdir())) < 2:
            time.sleep(0.05)
        print("ready", flush=True)
    threading.Thread(target=tell, daemon=True).start()
    list(run_tasks(write, [1, 2], 2))
"""
"""Two workers that are writing a file each."""

WORK = {
    "an import that swallows errors": """
sys.path.insert(0, sys.argv[1])
open(sys.argv[1] + "/slow.py", "w").write("import time; print('ready', flush=True); time.sleep(60)")
while True:
    try:
        import slow
    except BaseException:
        pass
""",
    "a callback of JAX": """
import jax, numpy as np
def callback(x):
    try:
        print("ready", flush=True)
        time.sleep(60)
    except BaseException:
        pass
    return x
jax.jit(lambda x: jax.pure_callback(callback, jax.ShapeDtypeStruct((), np.float32), x))(np.float32(0))
""",
    "work outside of Python": """
import jax.numpy as jnp
x = jnp.ones((6000, 6000))
print("ready", flush=True)
for _ in range(50):
    x = (x @ x).block_until_ready()
""",
    "the writing of a file": """
from pathlib import Path
from dvr_jax.runtime import files
def wait(descriptor):
    print("ready", flush=True)
    time.sleep(60)
files.os.fsync = wait
files.write_whole(Path(sys.argv[1]) / "result", b"half")
""",
}


@pytest.fixture(autouse=True)
def take_interrupts() -> Iterator[None]:
    """Let new processes take Ctrl-C, also where the tests themselves were started to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted(command: Sequence[str], seconds: float) -> tuple[int, str]:
    """Exit code and standard error of a command whose whole group of processes gets Ctrl-C."""
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    return process.returncode, errors


@pytest.mark.parametrize("work", WORK)
def test_whatever_a_command_does(work: str, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", BUSY.format(work=WORK[work]), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "interrupted\n")
    assert {path.name for path in tmp_path.iterdir()} <= {"slow.py"}


def test_a_process_may_be_terminated(tmp_path: Path) -> None:
    work = "print('ready', flush=True); time.sleep(60)"
    process = subprocess.Popen(
        [sys.executable, "-c", BUSY.format(work=work)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (143, "terminated\n")


def test_the_terminal_is_left_as_it_was(tmp_path: Path) -> None:
    """A bar is drawn with control characters, which names cannot write, and its library hides the cursor."""
    work = """
from dvr_jax.runtime.streams import secure_streams
secure_streams()
from dvr_jax.runtime.progress import Progress
with Progress("working", total=9, unit="things"):
    time.sleep(3)
    print("name \\x1b[31m", file=sys.stderr)
    print("ready", flush=True)
    time.sleep(60)
"""
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", BUSY.format(work=work)],
        stdout=subprocess.PIPE,
        stderr=end,
        env=os.environ | {"TERM": "xterm"},
    )
    os.close(end)
    assert process.stdout is not None
    # What is printed meanwhile goes where standard output leads, and not to the terminal.
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
    shown = b""
    with suppress(OSError):
        while part := os.read(terminal, 65536):
            shown += part
    assert b"\x1b[?25l" in shown and b"\\x1b[?" not in shown and b"\x1b[31mready" not in shown
    assert shown.endswith(b"\x1b[?25h\r\r\ninterrupted\r\n") or shown.endswith(
        b"\x1b[?25h\r\ninterrupted\r\n"
    )


def test_a_worker_removes_what_it_is_writing(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(WORKERS)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py"), str(tmp_path / "out")],
        env=os.environ | {"PYTHONPATH": os.getcwd()},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    assert len(list((tmp_path / "out").iterdir())) == 2
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "interrupted\n")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("seconds", [0.3, 0.6, 1.0])
def test_sampling_ends_at_once_and_writes_nothing(seconds: float, tmp_path: Path) -> None:
    file = tmp_path / "scenes.jsonl"
    command = ["-m", "dvr_jax.sample", "--number", "100000", "--out", str(file)]
    assert interrupted([sys.executable, *command], seconds) == (130, "interrupted\n")
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_ignores_interruptions_goes_on_ignoring_them(tmp_path: Path) -> None:
    """As a job that a shell has started in the background."""
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + BUSY.format(
        work="import os, signal; os.kill(os.getpid(), signal.SIGINT); print('done')"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, "done\n")


def assert_one_line_after_progress(errors: str) -> None:
    """Lines about the progress are indented."""
    *progress, last = errors.splitlines()
    assert last == "interrupted"
    assert all(line.startswith("  ") and "File " not in line for line in progress), errors


@pytest.mark.slow
def test_forty_moments_of_a_plan(tmp_path: Path) -> None:
    """The first moments are those of the imports, the last ones those of compiling."""
    cube = SceneObject("cube", "box", (0.05, 0.05, 0.05), (-0.35, 0.0), 0.0)
    goal = OnRegion("cube", Region((-0.35, 0.3), 0.0, (0.12, 0.12)))
    save_scene(tmp_path / "scene.json", make_scene([cube], goal))
    command = [sys.executable, "-m", "dvr_jax.plan", str(tmp_path / "scene.json"), "--out"]
    os.environ["DVR_JAX_CACHE"], kept = "off", os.environ["DVR_JAX_CACHE"]
    try:
        for number in range(40):
            seconds = 0.2 * (8 / 0.2) ** (number / 39)
            code, errors = interrupted([*command, str(tmp_path / "plan")], seconds)
            assert code == 130
            assert_one_line_after_progress(errors)
    finally:
        os.environ["DVR_JAX_CACHE"] = kept
    assert not (tmp_path / "plan" / "plan.json").exists()


@pytest.mark.slow
def test_ten_moments_of_a_sweep(tmp_path: Path) -> None:
    save_scenes(tmp_path / "scenes.jsonl", sample_scenes(4, 1, 5))
    options = ["--scenes", str(tmp_path / "scenes.jsonl"), "--out", str(tmp_path / "labels")]
    command = [sys.executable, "-m", "dvr_jax.sweep", *options, "--shard", "1", "--workers", "2"]
    for number in range(10):
        code, errors = interrupted(command, 0.2 * (20 / 0.2) ** (number / 9))
        assert code == 130
        assert_one_line_after_progress(errors)


@pytest.mark.slow
def test_ten_moments_of_a_training_that_goes_on_each_time(tmp_path: Path) -> None:
    write_shard(tmp_path / "labels-000000.parquet", *synthetic(0, 8), OPTIONS)
    options = ["--data", str(tmp_path / "labels-000000.parquet"), "--out", str(tmp_path / "out")]
    sizes = ["--image-size", "24", "--rays", "1", "--held-out", "0.4", "--batch-scenes", "2"]
    every = ["--log-every", "5", "--checkpoint-every", "5", "--validate-every", "100000"]
    command = [sys.executable, "-m", "dvr_jax.train", *options, *sizes, *every]
    for number in range(10):
        code, errors = interrupted(command, 0.3 * (30 / 0.3) ** (number / 9))
        assert code == 130
        assert_one_line_after_progress(errors)

    steps = [record["step"] for record in read_history(tmp_path / "out" / "history.jsonl")]
    assert (
        steps == sorted(set(steps)) and CheckpointFolder(tmp_path / "out" / "checkpoints").latest()
    )
