"""Markdown tables and numbers as the generated figures write them."""

from __future__ import annotations

from collections.abc import Sequence

EMPTY = "–"
"""What stands where there is no value."""


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table.

    Args:
        head: titles of the columns.
        rows: cells of each row, as many as there are titles.

    Returns:
        The lines of the table, without a line break at the end.
    """
    lines = [_line(head), _line(["---"] * len(head))]
    lines += [_line(row) for row in rows]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def seconds(value: float) -> str:
    """Write a time [s] with about three significant digits, and at most three decimals."""
    if value < 1:
        return f"{value:.3f}"
    if value < 10:
        return f"{value:.2f}"
    if value < 100:
        return f"{value:.1f}"
    return f"{value:,.0f}"


def ratio(value: float) -> str:
    """Write a ratio with one decimal below 100, and without any above."""
    return f"{value:.1f}" if value < 100 else f"{value:,.0f}"


def percent(share: float, decimals: int = 0) -> str:
    """Write a share as a percentage.

    Args:
        share: the share, 1 for all.
        decimals: digits after the point.

    Returns:
        The percentage with its sign.
    """
    return f"{100 * share:.{decimals}f} %"


def listing(values: Sequence[str]) -> str:
    """Write values in a row, with slashes between them."""
    return " / ".join(values)
