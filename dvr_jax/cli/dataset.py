"""Command line `python -m dvr_jax.dataset DIR ...`: the contents of folders of shards, beside the paper's data.

`python -m dvr_jax.dataset repack DIR ...` rewrites shards of an earlier layout in the present, smaller one.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from dvr_jax.dataset.counts import count_infeasible_sequences, count_labels
from dvr_jax.dataset.examples import count_targets, load_examples
from dvr_jax.dataset.repack import repack_folder
from dvr_jax.dataset.shards import find_shards


@dataclass(frozen=True)
class DatasetOptions:
    """Count the labels and training targets of folders of shards."""

    data: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of labeled sequences (*.parquet), or folders of them."""

    completions: int = 3
    """Number of continuations drawn of each refuted prefix."""

    k_max: int = 6
    """Largest number of actions."""

    seed: int = 0
    """Seed of the draw."""


@dataclass(frozen=True)
class RepackOptions:
    """Write the shards of folders in the present layout; scenes, labels, options and versions stay the same."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of labeled sequences (*.parquet)."""


class _Row(NamedTuple):
    """One line of the table."""

    name: str
    here: int
    paper: str


def main() -> int:
    """Read the options, and count or repack."""
    arguments = sys.argv[1:]
    if arguments[:1] == ["repack"]:
        repack(tyro.cli(RepackOptions, prog="python -m dvr_jax.dataset repack", args=arguments[1:]))
    else:
        count(tyro.cli(DatasetOptions, prog="python -m dvr_jax.dataset", args=arguments))
    return 0


def count(options: DatasetOptions) -> None:
    """Print the counts of shards beside those of the paper."""
    infos = find_shards(options.data)
    labels = count_labels(infos)
    known_infeasible = count_infeasible_sequences(infos, options.k_max)
    examples = load_examples(options.data, options.completions, options.k_max, options.seed)
    drawn = count_targets(examples)

    rows = [
        _Row("scenes", labels.scenes, "30,000"),
        _Row("scenes with a solution", labels.solved, "25,736"),
        _Row("feasible sequences", labels.feasible, "102,566"),
        _Row(f"infeasible, {options.completions} for each refuted prefix", drawn.infeasible, "2,741,573"),
        _Row("targets 1", drawn.ones, "1,803,684"),
        _Row("targets 0", drawn.zeros, "7,926,696"),
        _Row("  of these known", drawn.known_zeros, ""),
        _Row("targets 0 of first actions", drawn.first_zeros, ""),
        _Row("  of these known", drawn.known_first_zeros, ""),
        _Row("infeasible, labeled one by one", labels.infeasible, ""),
        _Row("refuted prefixes", labels.refuted_prefixes, ""),
        _Row(f"infeasible up to length {options.k_max} by both", known_infeasible, ""),
    ]
    print(f"{'':38}{'here':>12}{'paper':>12}")
    for row in rows:
        print(f"{row.name:38}{row.here:>12,}{row.paper:>12}")
    _print_histogram(labels.shortest, labels.solved)


def _print_histogram(shortest: Mapping[int, int], solved: int) -> None:
    """Print the number of scenes by the length of their shortest solution."""
    print("length of the shortest solution: scenes")
    for length, number in shortest.items():
        bar = "#" * round(50 * number / solved)
        print(f"  {length:>2}: {number:>7,} ({number / solved:5.1%}) {bar}")


def repack(options: RepackOptions) -> None:
    """Repack the shards of each folder, and print its size before and after."""
    for folder in options.folders:
        scenes = 0
        bytes_before = 0
        bytes_after = 0
        for shard in repack_folder(folder):
            scenes += len(shard.info.scenes)
            bytes_before += shard.bytes_before
            bytes_after += shard.bytes_after
        print(
            f"{folder}: {scenes:,} scenes, {bytes_before:,} bytes before and {bytes_after:,} after, "
            f"{bytes_after / scenes:.0f} bytes a scene"
        )
