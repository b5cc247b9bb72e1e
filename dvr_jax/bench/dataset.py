"""What folders of labels hold: scenes, sequences and training targets, as metrics beside the paper's training data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.bench.paper import DATASET
from dvr_jax.dataset.counts import count_labels
from dvr_jax.dataset.examples import count_targets, load_examples
from dvr_jax.dataset.shards import find_shards


@dataclass(frozen=True)
class DatasetOptions:
    """Count the labels and training targets of folders of shards."""

    data: tuple[Path, ...]
    """Folders of shards."""
    completions: int = 3
    """Continuations drawn of each refuted prefix."""
    k_max: int = 6
    """Largest number of actions."""
    seed: int = 0
    """Of the draw."""
    out: Path | None = None
    """JSON file to write the counts to."""


def shortest_name(length: int) -> str:
    """Name the metric of the scenes whose shortest solution has this length."""
    return f"scenes with a shortest solution of {length} actions"


def run(arguments: list[str]) -> int:
    """Print the counts beside the paper's."""
    options = tyro.cli(DatasetOptions, prog="python -m dvr_jax.bench dataset", args=arguments)
    labels = count_labels(find_shards(options.data))
    targets = count_targets(
        load_examples(options.data, options.completions, options.k_max, options.seed)
    )

    counts = {
        "scenes": labels.scenes,
        "scenes with a solution": labels.solved,
        "feasible sequences": labels.feasible,
        "infeasible sequences": targets.infeasible,
        "targets 1": targets.ones,
        "targets 0": targets.zeros,
        **{shortest_name(length): number for length, number in labels.shortest.items()},
    }
    for name, count in counts.items():
        paper = f"{DATASET[name]:>12,}" if name in DATASET else ""
        print(f"{name:<48}{count:>12,}{paper}")

    if options.out is not None:
        metrics = [Metric(name, count, "count", Direction.EQUAL) for name, count in counts.items()]
        save_metrics(options.out, "dataset", metrics)
    return 0
