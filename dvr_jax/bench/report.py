"""The figures of README and docs, written from the committed results of the benchmarks.

A figure stands between two markers, on lines of its own or within a line:

    <!-- figures: NAME -->
    ...
    <!-- end figures -->

`python -m dvr_jax.bench report` replaces what is between them; NAME is one of `dvr_jax.bench.figures.FIGURES`. With
`--check` it changes nothing, and its exit code is 1 where a file would change. A figure whose results are missing gets
a line that says so; `--check` passes it over.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.bench.committed import RESULTS, CommittedResults, MissingResultsError
from dvr_jax.bench.figures import FIGURES
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole

START = re.compile(r"<!-- figures: (?P<name>[a-z0-9-]+) -->")
"""Marker before a figure."""

END = "<!-- end figures -->"
"""Marker after a figure."""

EXIT_OUTDATED = 1
"""Exit code of `--check` where a file would change."""


@dataclass(frozen=True)
class ReportOptions:
    """Write the figures of README.md and docs/ from the committed results."""

    check: bool = False
    """Change nothing; the exit code is 1 when a file would change."""
    show: bool = False
    """Print all figures with their names instead, and change nothing."""
    repository: Path = Path(__file__).parents[2]
    """Folder with README.md, docs/ and bench/results/; by default the checkout that this package is part of."""


def run(arguments: list[str]) -> int:
    """Write, check or show the figures."""
    options = tyro.cli(ReportOptions, prog="python -m dvr_jax.bench report", args=arguments)
    if not (options.repository / RESULTS).is_dir():
        raise DvrError(
            f"{options.repository} has no folder {RESULTS}; --repository takes a checkout of the repository."
        )

    results = CommittedResults(options.repository)
    if options.show:
        _show(results)
        return 0

    changed = 0
    for path in documents(options.repository):
        before = path.read_text(encoding="utf-8")
        after = fill_figures(before, results, path.name, skip_missing=options.check)
        if after == before:
            continue

        changed += 1
        name = path.relative_to(options.repository)
        if options.check:
            print(
                f"{name} does not show the committed results; python -m dvr_jax.bench report writes them"
            )
        else:
            write_whole(path, after.encode())
            print(f"{name} written")
    return EXIT_OUTDATED if options.check and changed else 0


def documents(repository: Path) -> list[Path]:
    """List the README and all pages of docs/ that a repository has."""
    pages = [repository / "README.md", *sorted((repository / "docs").rglob("*.md"))]
    return [page for page in pages if page.is_file()]


def fill_figures(
    text: str, results: CommittedResults, document: str, skip_missing: bool = False
) -> str:
    """Replace what is between the markers of a document.

    Args:
        text: the document.
        results: the committed results.
        document: name of the document, for errors.
        skip_missing: leave figures as they are whose results are missing; otherwise they get a line that says so.

    Returns:
        The document with its figures.

    Raises:
        DvrError: A marker names no figure, or has no end.
    """
    parts: list[str] = []
    position = 0
    while match := START.search(text, position):
        name = match["name"]
        if name not in FIGURES:
            raise DvrError(f"{document}: there is no figure '{name}'; valid: {', '.join(FIGURES)}.")

        # A figure ends before the next one begins.
        end = text.find(END, match.end())
        following = START.search(text, match.end())
        if end < 0 or (following is not None and following.start() < end):
            raise DvrError(
                f"{document}: the figure '{name}' has no end; valid is a marker {END} after it."
            )

        old = text[match.end() : end]
        try:
            new = _surround(FIGURES[name](results), old)
        except MissingResultsError as error:
            line = f"*No figures: {error.file.as_posix()} is missing.*"
            new = old if skip_missing else _surround(line, old)
        parts += [text[position : match.end()], new]
        position = end
    return "".join([*parts, text[position:]])


def _surround(figure: str, old: str) -> str:
    """Put a figure on lines of its own, but for a short one whose markers stand within a line."""
    is_inline = "\n" not in old and "\n" not in figure

    # Some Markdown dialects see a table only after an empty line.
    return figure if is_inline else f"\n\n{figure}\n\n"


def _show(results: CommittedResults) -> None:
    for name in FIGURES:
        print(f"== {name}")
        try:
            print(FIGURES[name](results))
        except MissingResultsError as error:
            print(f"missing: {error.file.as_posix()}", file=sys.stderr)
        print()
