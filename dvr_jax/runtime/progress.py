"""Progress of what takes long, on standard error: a bar or a moving line on a terminal, plain lines elsewhere.

Nothing is shown of what ends within `PATIENCE`. The terminal is drawn by the library rich, which redraws below what is
printed meanwhile.
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from threading import Event, Thread
from types import TracebackType
from typing import Any, Self

from dvr_jax.runtime.interruption import undone_at_interrupt

PATIENCE = 2.0
"""Time after which progress is shown for the first time [s]."""

LONGEST_SILENCE = 30.0
"""Longest time between two lines where there is no terminal [s]; the first ones come sooner."""

RECENT = 20
"""Number of things whose times tell how long the others will take."""

SHOW_CURSOR = b"\x1b[?25h\r\n"
"""What shows the cursor of a terminal again, and begins a new line."""

REDRAW = 0.2
"""Time between two looks at the state of the computation on a terminal [s]."""


def _no_detail() -> str:
    """Add nothing to a line."""
    return ""


class Progress:
    """Shows how far a computation is while its `with` block runs."""

    def __init__(
        self,
        activity: str,
        total: int | None = None,
        unit: str = "",
        done: int = 0,
        detail: Callable[[], str] = _no_detail,
    ) -> None:
        """Describe the computation.

        Args:
            activity: What is being done, as in "planning".
            total: Number of things to do; None if it is not known.
            unit: What these things are, in the plural, as in "scenes".
            done: Number of them that an earlier run did.
            detail: Function that returns what is being done at the moment, or an empty text. It is called by another
                thread.
        """
        self.activity = activity
        self.total = total
        self.unit = unit
        self.done = done
        self.detail = detail
        self._begin = time.monotonic()
        self._recent: deque[tuple[float, int]] = deque(maxlen=RECENT)
        """When which numbers were done, for the first time the start."""
        self._ended = Event()
        self._thread = Thread(target=self._show, daemon=True)

    def __enter__(self) -> Self:
        """Begin to watch the clock."""
        self._begin = time.monotonic()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Show the last state and stop."""
        self._ended.set()
        self._thread.join()

    def advance(self) -> None:
        """Count one more thing that is done."""
        self.reach(self.done + 1)

    def reach(self, done: int) -> None:
        """State how many things are done.

        Args:
            done: Number of things that are done, one more than before.
        """
        if not self._recent:
            # An earlier run has done the others.
            self._recent.append((self._begin, done - 1))
        self._recent.append((time.monotonic(), done))
        self.done = done

    def describe(self) -> str:
        """Return the state of the computation as one line of text."""
        seconds = time.monotonic() - self._begin
        parts = [f"{self.activity}: {_duration(seconds)}"]

        if self.total is not None:
            parts = [f"{self.activity}: {self.done} of {self.total} {self.unit}"]
            each = self._seconds_each()
            if each is None:
                parts.append(_duration(seconds))
            elif self.done < self.total:
                parts.append(f"{_duration(each)} each")
                parts.append(f"{_duration(each * (self.total - self.done))} to go")

        detail = self.detail()
        return ", ".join([*parts, *([detail] if detail else [])])

    def _seconds_each(self) -> float | None:
        """Return the time that each of the last things took; None if it is not known.

        The first things often take longer, because programs are compiled.
        """
        recent = list(self._recent)
        if len(recent) < 2:
            return None
        (begin, first), (end, last) = recent[0], recent[-1]
        return (end - begin) / (last - first)

    def _show(self) -> None:
        """Show the progress until the block ends; another thread runs this."""
        if self._ended.wait(PATIENCE):
            return

        if sys.stderr is None:
            return
        if sys.stderr.isatty():
            self._draw()
        else:
            self._write_lines()

    def _write_lines(self) -> None:
        """Write a line now and then, and one at the end if things were counted."""
        pause = PATIENCE
        while True:
            print(f"  {self.describe()}", file=sys.stderr, flush=True)
            if self._ended.wait(pause):
                break
            pause = min(1.5 * pause, LONGEST_SILENCE)

        if self.total is not None:
            print(f"  {self.describe()}", file=sys.stderr, flush=True)

    def _draw(self) -> None:
        """Draw a bar, or a moving line if there is nothing to count, until the block ends."""
        display = _display(is_counted=self.total is not None)
        # Whoever ends the process meanwhile has to show the cursor again, which the library hides.
        with undone_at_interrupt(SHOW_CURSOR), display:
            task = display.add_task(self.activity, total=self.total, completed=self.done)
            for _ in self._moments():
                line = f"{self.activity} {self.detail()}".rstrip()
                display.update(task, completed=self.done, description=line)

    def _moments(self) -> Iterator[None]:
        """Yield every now and then, and once more after the block has ended."""
        while not self._ended.wait(REDRAW):
            yield
        yield


def _display(is_counted: bool) -> Any:
    """Return rich's display on the terminal, which is empty."""
    # Imported here, because it takes a tenth of a second that short commands need not wait for.
    from rich import console, progress

    columns: list[Any] = [progress.TextColumn("  {task.description}")]
    if is_counted:
        columns += [progress.BarColumn(), progress.MofNCompleteColumn()]
    else:
        columns.insert(0, progress.SpinnerColumn())
    columns.append(progress.TimeElapsedColumn())
    if is_counted:
        columns += [progress.TextColumn("to go:"), progress.TimeRemainingColumn()]

    # The streams of a command write control characters as numbers, so the display has a stream of its own. What is
    # printed meanwhile appears above it, unless standard output goes elsewhere.
    terminal = os.fdopen(os.dup(sys.stderr.fileno()), "w", encoding="utf-8")
    return progress.Progress(
        *columns,
        console=console.Console(file=terminal),
        redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),
    )


def _duration(seconds: float) -> str:
    """Return a time as a person says it."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
