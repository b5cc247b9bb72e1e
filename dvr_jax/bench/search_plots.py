"""Box plots of several searches of the same scenes, as in figures 5 to 7 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dvr_jax.bench.scene_result import SceneResult, group_by_length
from dvr_jax.bench.search_statistics import Table
from dvr_jax.errors import DvrError


@dataclass(frozen=True)
class Panel:
    """One plot of the picture."""

    label: str
    """Label of the vertical axis."""
    scale: str
    """Its scale, by matplotlib's name."""
    value: Callable[[SceneResult], float]
    """What is plotted."""


PANELS = (
    Panel("total time [s]", "log", lambda result: result.total_seconds),
    Panel("sequences proposed", "log", lambda result: result.sequences_proposed),
    Panel("path NLPs solved", "linear", lambda result: result.path_nlps),
    Panel("keyframe NLPs solved", "symlog", lambda result: result.keyframe_nlps),
)


def save_plots(path: Path, tables: Mapping[str, Table], k_max: int) -> None:
    """Plot each of `PANELS` by length of the solution, one color a search.

    Args:
        path: PNG file to write.
        tables: results by the name of the search.
        k_max: largest number of actions.

    Raises:
        DvrError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise DvrError(
            "the plots need matplotlib: pip install '.[plots]' in the repository."
        ) from None

    figure = Figure(figsize=(17, 4), layout="constrained")
    found = {result.length for table in tables.values() for result in table.values()}
    lengths = [length for length in range(1, k_max + 1) if length in found]

    for axes, panel in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        _draw_panel(axes, panel, tables, k_max)
        axes.set(
            xlabel="actions of the solution",
            ylabel=panel.label,
            yscale=panel.scale,
            xticks=lengths,
        )
        axes.legend()
    figure.savefig(path, dpi=110)


def _draw_panel(axes: Any, panel: Panel, tables: Mapping[str, Table], k_max: int) -> None:
    """Draw the boxes of all searches, side by side at each length."""
    width = 0.8 / len(tables)
    for i, (name, table) in enumerate(tables.items()):
        groups = group_by_length(list(table.values()), k_max)
        values = {
            length: [panel.value(result) for result in group]
            for length, group in groups.items()
            if group
        }
        offset = (i - (len(tables) - 1) / 2) * width
        boxes = axes.boxplot(
            list(values.values()),
            positions=[length + offset for length in values],
            widths=0.8 * width,
            patch_artist=True,
            manage_ticks=False,
            flierprops={"markersize": 2},
        )
        for box in boxes["boxes"]:
            box.set_facecolor(f"C{i}")

        # An empty line, since a legend takes no boxes.
        axes.plot([], [], color=f"C{i}", linewidth=6, label=name)
