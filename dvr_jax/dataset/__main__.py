"""Command line `python -m dvr_jax.dataset DIR ...`: what folders of shards hold, beside the paper's data."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dvr_jax.dataset.examples import count_targets, find_shards, load_examples
from dvr_jax.dataset.manifest import count_infeasible_sequences, count_labels
from dvr_jax.errors import run_command


@dataclass(frozen=True)
class DatasetOptions:
    """Count the labels and training targets of folders of shards."""

    data: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of labelled sequences (*.parquet), or folders of them."""
    completions: int = 3
    """Continuations drawn of each refuted prefix."""
    k_max: int = 6
    """Largest number of actions."""
    seed: int = 0
    """Of the draw."""


def main() -> int:
    """Read the options, load, print the table."""
    options = tyro.cli(DatasetOptions, prog="python -m dvr_jax.dataset")
    infos = find_shards(options.data)
    labels = count_labels(infos)
    known = count_infeasible_sequences(infos, options.k_max)
    drawn = count_targets(load_examples(options.data, options.completions, options.k_max, options.seed))
    table: list[tuple[str, int, str]] = [
        ("scenes", labels.scenes, "30,000"),
        ("scenes with a solution", labels.solved, "25,736"),
        ("feasible sequences", labels.feasible, "102,566"),
        (f"infeasible, {options.completions} for each refuted prefix", drawn.infeasible, "2,741,573"),
        ("targets 1", drawn.ones, "1,803,684"),
        ("targets 0", drawn.zeros, "7,926,696"),
        ("  of these known", drawn.known_zeros, ""),
        ("targets 0 of first actions", drawn.first_zeros, ""),
        ("  of these known", drawn.known_first_zeros, ""),
        ("infeasible, labelled one by one", labels.infeasible, ""),
        ("refuted prefixes", labels.refuted_prefixes, ""),
        (f"infeasible up to length {options.k_max} by both", known, ""),
    ]
    print(f"{'':38}{'here':>12}{'paper':>12}")
    print("\n".join(f"{name:38}{number:>12,}{paper:>12}" for name, number, paper in table))
    print("length of the shortest solution: scenes")
    for length, number in labels.shortest.items():
        print(f"  {length:>2}: {number:>7,} ({number / labels.solved:5.1%}) {'#' * round(50 * number / labels.solved)}")
    return 0


if __name__ == "__main__":
    run_command(main)
