"""Progress: nothing of what is quick, lines where there is no terminal, a bar where there is one."""

import os
import pty
import re
import subprocess
import sys
import time

import pytest

from dvr_jax.runtime import progress
from dvr_jax.runtime.progress import Progress

CODE = """
import sys, time
from dvr_jax.runtime import progress
from dvr_jax.runtime.streams import secure_streams
secure_streams()
progress.PATIENCE = 0.2
with progress.Progress("planning", 4, "scenes") as bar:
    for _ in range(4):
        time.sleep(0.3)
        bar.advance()
        print("result", flush=True)
        print("remark", file=sys.stderr, flush=True)
"""


def test_what_is_quick_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress("planning", 3, "scenes") as shown:
        shown.reach(3)
    assert capsys.readouterr() == ("", "")


def test_lines_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 0.05)
    with Progress("planning", 10, "scenes", done=2, detail=lambda: "compiling") as shown:
        time.sleep(0.2)
        for _ in range(4):
            shown.advance()
        time.sleep(0.3)
        for _ in range(4):
            shown.advance()
    lines = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"  planning: 2 of 10 scenes, 0\.\d s, compiling", lines[0])
    assert any(
        re.fullmatch(r"  planning: 6 of 10 scenes, 0\.\d s each, 0\.\d s to go, compiling", line)
        for line in lines
    )
    assert lines[-1] == "  planning: 10 of 10 scenes, compiling"


def test_a_computation_of_unknown_length_says_how_long_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 0.05)
    with Progress("checking"):
        time.sleep(0.2)
    assert re.match(r"  checking: 0\.\d s\n", capsys.readouterr().err)


def test_a_bar_on_a_terminal() -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    done = subprocess.Popen(
        [sys.executable, "-c", CODE],
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=environment,
        text=True,
    )
    # Results go where they belong, and remarks above the bar.
    assert done.communicate(timeout=60)[0] == "result\n" * 4 and done.returncode == 0
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:
            break
        shown += part
    text = shown.decode()
    assert "planning" in text and "4/4" in text and "━" in text
    assert text.count("remark") == 4 and "\\x1b" not in text
