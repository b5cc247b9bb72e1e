"""Processes share compiled programs: one compiles, the others wait and load; and load ahead what the last run used."""

import os
import subprocess
import sys
import time
from pathlib import Path

from dvr_jax.runtime.file_lock import only_process
from dvr_jax.runtime.load_ahead import load_in_background, take_loaded

CODE = """
import sys, time
import numpy as np
import jax.numpy as jnp
from dvr_jax.runtime import compilation
from dvr_jax.runtime.compilation import Program, keep_programs_of, load_programs_of

traced = []
def double(x):
    traced.append(x)
    time.sleep(3)  # as if it took long to compile
    return 2 * x
double.__module__ = "dvr_jax.any"

load_programs_of("test")
assert float(Program(double)(np.float32(4))) == 8
keep_programs_of("test")
print(len(traced), len(compilation._used))
"""


def test_one_of_two_processes_compiles(tmp_path: Path) -> None:
    environment = {**os.environ, "DVR_JAX_CACHE": str(tmp_path)}

    def start() -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", CODE], env=environment, stdout=subprocess.PIPE, text=True
        )

    both = [start(), start()]
    said = sorted(process.communicate()[0] for process in both)
    assert said == ["0 1\n", "1 1\n"]
    # No lock is left behind.
    assert {path.suffix for path in tmp_path.glob("*/*")} == {".executable", ".txt"}

    # A third process loads it ahead.
    third = start()
    assert third.communicate()[0] == "0 1\n" and third.returncode == 0


def test_a_lock_is_held_by_one_process_at_a_time(tmp_path: Path) -> None:
    code = """
import sys, time
from pathlib import Path
from dvr_jax.runtime.file_lock import only_process
with only_process(Path(sys.argv[1])):
    print("in", flush=True)
    time.sleep(1)
"""
    path = tmp_path / "lock"
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None and other.stdout.readline() == "in\n"
    begin = time.monotonic()
    with only_process(path):
        assert time.monotonic() - begin > 0.5
    assert other.wait() == 0


def test_what_is_taken_before_its_turn_is_not_loaded_twice() -> None:
    loaded = []

    def load(path: Path) -> object:
        loaded.append(path)
        time.sleep(0.3)
        return lambda: path.name

    first, second, third = (Path(name) for name in ("first", "second", "third"))
    load_in_background([first, second, third], load)  # type: ignore[arg-type]
    time.sleep(0.1)
    # The second one has not begun: the caller loads it itself.
    assert take_loaded(second) is None
    executable = take_loaded(first)
    assert executable is not None and executable() == "first"
    time.sleep(0.5)
    assert loaded == [first, third]
    assert take_loaded(first) is None and take_loaded(Path("other")) is None
