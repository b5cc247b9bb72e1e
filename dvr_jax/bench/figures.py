"""The registry of figures: what a marker in README or docs can name, and the function that writes its text."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dvr_jax.bench import (
    execution_figures,
    motion_figures,
    scene_figures,
    search_figures,
    solver_figures,
)
from dvr_jax.bench.committed import CommittedResults

Figure = Callable[[CommittedResults], str]
"""Writes the Markdown of a figure from the committed results."""

FIGURES: Mapping[str, Figure] = {
    "headline": search_figures.headline,
    "search-table": search_figures.search_table,
    "search-summary": search_figures.search_summary,
    "search-faithful": search_figures.search_faithful,
    "solved": search_figures.solved,
    "search-scenes": search_figures.search_scenes,
    "search-version": search_figures.search_version,
    "scenes": scene_figures.scenes,
    "execution": execution_figures.execution,
    "execution-causes": execution_figures.causes,
    "motions": motion_figures.motions,
    "motion-distances": motion_figures.motion_distances,
    "speed": solver_figures.speed,
    "recall": solver_figures.recall,
    "labels": solver_figures.labels,
    "peers": solver_figures.peers,
    "table1": solver_figures.table1,
    "drawn": solver_figures.drawn,
    "dataset": solver_figures.dataset,
    "networks": solver_figures.networks,
}
"""Figures by the name that a marker gives."""
