"""Worker processes do not take Ctrl-C from their very start, when they import what they need."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import os, signal, sys, time
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.runtime.task_pool import run_tasks

if __name__ == "__mp_main__":
    # A worker imports this file before it is told to ignore Ctrl-C.
    is_deaf = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    os.write(1, f"{is_deaf}\\n".encode())

def work(number):
    return [number]

if __name__ == "__main__":
    if sys.argv[1] == "tasks":
        list(run_tasks(work, [1, 2], 2))
    else:
        with worker_processes(2) as pool:
            list(pool.map(work, [1, 2]))
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
"""


@pytest.mark.parametrize("kind", ["tasks", "pool"])
def test_workers_are_deaf_while_they_import(kind: str, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(CODE)
    ended = subprocess.run(
        [sys.executable, str(tmp_path / "script.py"), kind],
        env=os.environ | {"PYTHONPATH": os.getcwd()},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode == 0, ended.stderr
    assert set(ended.stdout.split()) == {"True"}


def test_the_threads_own_mask_comes_back() -> None:
    from dvr_jax.runtime.processes import interrupts_held_back

    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with interrupts_held_back():
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
