"""The site builds without a warning, and a dead link or a missing reference is one."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="the tool of the site is an optional dependency: make docs")

DOCS = Path(__file__).parents[2] / "docs"


def build(source: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """Build a site as `make docs` does."""
    strict = ["--builder", "html", "--nitpicky", "--fail-on-warning", "--keep-going"]
    places = ["--doctree-dir", folder / "doctrees", "--conf-dir", DOCS, source, folder / "site"]
    command = [sys.executable, "-m", "sphinx", *strict, *map(str, places)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.slow
def test_the_site_builds_and_lists_every_public_name(tmp_path: Path) -> None:
    import dvr_jax

    done = build(DOCS, tmp_path)
    assert done.returncode == 0, done.stderr

    page = (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
    assert [
        name for name in dvr_jax.__all__ if f'id="dvr_jax.{name}"' not in page and name[0] != "_"
    ] == []


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[there](nowhere.md)", "nowhere.md"),
        ("[there](#no-such-heading)", "no-such-heading"),
        ("![picture](nowhere.png)", "nowhere.png"),
        ("{py:func}`dvr_jax.no_such_function`", "dvr_jax.no_such_function"),
    ],
)
def test_a_reference_that_leads_nowhere_fails_the_build(
    text: str, complaint: str, tmp_path: Path
) -> None:
    source = tmp_path / "docs"
    source.mkdir()
    (source / "index.md").write_text(f"# Title\n\n{text}\n")
    done = build(source, tmp_path / "out")
    assert done.returncode != 0
    assert complaint in done.stderr
