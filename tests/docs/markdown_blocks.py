"""Code blocks of Markdown pages, and how a test runs them in the order of a page."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

SLOW = "<!-- slow -->"
"""A page with this comment takes longer than 20 seconds."""

NOT_RUN = "<!-- not run:"
"""A block after a comment that begins like this is only compiled."""


@dataclass(frozen=True)
class Block:
    """One fenced block of code."""

    language: str
    code: str
    line: int
    """Line of the page on which the block's code begins, from 1."""
    runs: bool
    """False if the page says that the block cannot run in a test."""


def read_blocks(page: Path) -> list[Block]:
    """Return the Python and shell blocks of a page, in order; `console` blocks are for people."""
    blocks: list[Block] = []
    before = None

    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        if token.type == "fence" and token.info in ("python", "bash"):
            assert token.map is not None
            marked = (
                before is not None and before.type == "html_block" and NOT_RUN in before.content
            )
            blocks.append(Block(token.info, token.content, token.map[0] + 2, not marked))
        before = token

    return blocks


def run_page(page: Path, folder: Path) -> None:
    """Run the blocks of a page in a folder, which is the current one; Python blocks share their names."""
    names: dict[str, object] = {"__name__": "__main__"}
    scripts = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"

    for block in read_blocks(page):
        if block.language == "bash":
            subprocess.run(
                ["bash", "-euc", block.code],
                check=True,
                cwd=folder,
                env={**os.environ, "PATH": scripts},
            )
            continue
        # Empty lines in front make a traceback name the line of the page.
        program = compile("\n" * (block.line - 1) + block.code, str(page), "exec")
        if block.runs:
            exec(program, names)
