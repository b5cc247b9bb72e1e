"""Worker processes end with the one that has them: at an error, at Ctrl-C, and when it is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CODE = """
import os, signal, sys, time
from dvr_jax.runtime.processes import worker_processes

def work(number):
    written = f"{sys.argv[1]}/../{number}"  # renamed once it is whole: who counts the names reads what they hold
    with open(written, "w") as file:
        file.write(str(os.getpid()))
    os.rename(written, f"{sys.argv[1]}/{number}")
    time.sleep(0.0 if number == 0 else 60.0)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores Ctrl-C
    with worker_processes(2) as pool:
        futures = [pool.submit(work, number) for number in range(6)]
        futures[0].result()
        while len(os.listdir(sys.argv[1])) < 3:
            time.sleep(0.05)
        print("ready", flush=True)
        if sys.argv[2] == "error":
            raise OSError("disk full")
        futures[1].result()
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has asked for its exit code does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("end", ["error", "SIGINT", "SIGTERM", "SIGKILL"])
def test_workers_end_with_their_parent(tmp_path: Path, end: str) -> None:
    script, begun = tmp_path / "script.py", tmp_path / "begun"
    script.write_text(CODE)
    begun.mkdir()
    parent = subprocess.Popen(
        [sys.executable, str(script), str(begun), end],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert parent.stdout is not None and parent.stdout.readline() == "ready\n"
    workers = {int(path.read_text()) for path in begun.iterdir()}
    assert len(workers) == 2
    if end != "error":
        os.kill(parent.pid, getattr(signal, end))
    assert parent.wait(60) != 0
    limit = time.monotonic() + 60
    while any(map(alive, workers)) and time.monotonic() < limit:
        time.sleep(0.1)
    assert not any(map(alive, workers)) and len(list(begun.iterdir())) == 3
