"""Ctrl-C at any moment of a command: one line, exit code 130, and nothing half done."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from dvr_jax.scene.files import save_scene, save_scenes
from dvr_jax.scene.random_scenes import sample_scenes

BUSY = """
import sys
from dvr_jax.runtime.interruption import end_on_interrupt
end_on_interrupt()
import time
{work}
"""
"""A command that is busy with something when it is interrupted."""

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


@pytest.mark.slow
def test_forty_moments_of_a_plan(tmp_path: Path) -> None:
    """The first moments are those of the imports, the last ones those of compiling."""
    (scene,) = sample_scenes(1, 1, 3)
    save_scene(tmp_path / "scene.json", scene)
    command = [sys.executable, "-m", "dvr_jax.plan", str(tmp_path / "scene.json"), "--out"]
    os.environ["DVR_JAX_CACHE"], kept = "off", os.environ["DVR_JAX_CACHE"]
    try:
        for number in range(40):
            seconds = 0.2 * (8 / 0.2) ** (number / 39)
            code, errors = interrupted([*command, str(tmp_path / "plan")], seconds)
            assert code == 130 and errors.splitlines()[-1] == "interrupted"
            assert all(line.startswith("  ") for line in errors.splitlines()[:-1]), errors
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
        lines = errors.splitlines()
        assert code == 130 and lines[-1] == "interrupted"
        assert all("scenes, " in line for line in lines[:-1]), errors
