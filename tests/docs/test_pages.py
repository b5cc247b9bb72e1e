"""The code of the README and of the documentation runs as it stands."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest
from markdown_blocks import SLOW, read_blocks, run_page

REPOSITORY = Path(__file__).parents[2]
VIEWER = REPOSITORY / "docs" / "tutorials" / "trajectories.md"
"""The page whose last block needs a viewer: a test of its own runs it."""

PAGES = [REPOSITORY / "README.md", *sorted({*(REPOSITORY / "docs").rglob("*.md")} - {VIEWER})]
"""All other pages."""

LARGEST_README = 7168
"""Bytes."""


def page_parameter(page: Path) -> object:
    """Return the page as a test's parameter, marked as slow if it says so."""
    marks = [pytest.mark.slow] if SLOW in page.read_text(encoding="utf-8") else []
    return pytest.param(page, id=str(page.relative_to(REPOSITORY)), marks=marks)


@pytest.mark.parametrize("page", [page_parameter(page) for page in PAGES if read_blocks(page)])
def test_the_code_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run_page(page, tmp_path)


def test_the_readme_is_short_and_begins_with_the_animation() -> None:
    text = (REPOSITORY / "README.md").read_bytes()
    assert len(text) <= LARGEST_README
    assert text.splitlines()[2].startswith(b"![")


def test_blocks_are_found_with_their_lines(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    first = "text\n\n```python\na = 1\n```\n\n"
    second = "<!-- not run: no display -->\n```python\n1 / 0\n```\n\n"
    page.write_text(f"{first}{second}```json\n{{}}\n```\n")
    assert [(block.code, block.line, block.runs) for block in read_blocks(page)] == [
        ("a = 1\n", 4, True),
        ("1 / 0\n", 9, False),
    ]
    run_page(page, tmp_path)


def test_an_error_names_the_line_of_the_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("text\n\n```python\na = 1\nraise ValueError\n```\n")
    with pytest.raises(ValueError) as caught:
        run_page(page, tmp_path)
    assert caught.traceback[-1].lineno + 1 == 5


def test_the_viewer_sees_every_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All blocks of the page; the one that plays the trajectory gets a viewer without a window."""
    [viewing] = [block.code for block in read_blocks(VIEWER) if not block.runs]
    monkeypatch.chdir(tmp_path)
    run_page(VIEWER, tmp_path)

    seen: list[np.ndarray] = []
    slept: list[float] = []

    @contextmanager
    def launch_passive(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(sync=lambda: seen.append(data.qpos.copy()))

    viewer = ModuleType("mujoco.viewer")
    viewer.launch_passive = launch_passive  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mujoco.viewer", viewer)
    monkeypatch.setattr(mujoco, "viewer", viewer, raising=False)
    monkeypatch.setattr(time, "sleep", slept.append)
    exec(viewing, {})

    with np.load("out/plan/trajectory.npz") as motion:
        np.testing.assert_array_equal(seen, motion["qpos"])
        assert sum(slept) == pytest.approx(motion["time"][-1], rel=0.01)
