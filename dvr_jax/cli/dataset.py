"""Command line `python -m dvr_jax.dataset DIR ...`: what folders of shards hold, beside the paper's data.

`python -m dvr_jax.dataset repack DIR ...` rewrites shards of an earlier layout in the present, smaller one.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from dvr_jax.cli.options import LARGEST, LARGEST_NUMBER, parse_options, require_range
from dvr_jax.errors import run_command

if TYPE_CHECKING:
    from dvr_jax.dataset.counts import LabelCounts


@dataclass(frozen=True)
class DatasetOptions:
    """Count the labels and training targets of folders of shards."""

    data: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of labeled sequences (*.parquet), or folders of them."""
    completions: int = 3
    """Number of continuations that are drawn for each refuted prefix."""
    k_max: int = 6
    """Largest number of actions."""
    seed: int = 0
    """Seed of the draw."""


@dataclass(frozen=True)
class RepackOptions:
    """Write the shards of folders in the present layout; scenes, labels, options and versions stay the same."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of labeled sequences (*.parquet)."""


@dataclass(frozen=True, slots=True)
class _Line:
    """One line of the table."""

    name: str
    number: int
    paper: str = ""
    """The paper's number, where it states one."""

    def __str__(self) -> str:
        return f"{self.name:38}{self.number:>12,}{self.paper:>12}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Count what folders of shards hold and print it beside the paper's numbers.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    if given[:1] == ["repack"]:
        return repack(given[1:])
    options = parse_options(DatasetOptions, "dataset", given)
    require_range("k_max", options.k_max, 1, LARGEST["k_max"])
    require_range("completions", options.completions, 0, LARGEST_NUMBER)

    from dvr_jax.dataset.counts import count_infeasible_sequences, count_labels
    from dvr_jax.dataset.examples import count_targets, load_examples
    from dvr_jax.dataset.shards import find_shards
    from dvr_jax.runtime.progress import Progress

    with Progress("counting the labels"):
        infos = find_shards(options.data)
        labels = count_labels(infos)
        known = count_infeasible_sequences(infos, options.k_max)
        targets = count_targets(
            load_examples(options.data, options.completions, options.k_max, options.seed)
        )

    table = [
        _Line("scenes", labels.scenes, "30,000"),
        _Line("scenes with a solution", labels.solved, "25,736"),
        _Line("feasible sequences", labels.feasible, "102,566"),
        _Line(
            f"infeasible, {options.completions} for each refuted prefix",
            targets.infeasible,
            "2,741,573",
        ),
        _Line("targets 1", targets.ones, "1,803,684"),
        _Line("targets 0", targets.zeros, "7,926,696"),
        _Line("  of these known", targets.known_zeros),
        _Line("targets 0 of first actions", targets.first_zeros),
        _Line("  of these known", targets.known_first_zeros),
        _Line("infeasible, labeled one by one", labels.infeasible),
        _Line("refuted prefixes", labels.refuted_prefixes),
        _Line(f"infeasible up to length {options.k_max} by both", known),
    ]
    print(f"{'':38}{'here':>12}{'paper':>12}")
    print("\n".join(map(str, table)))
    _print_lengths(labels)
    return 0


def repack(arguments: Sequence[str]) -> int:
    """Repack the shards of folders, and print the size of each folder before and after.

    Args:
        arguments: Options as text.

    Returns:
        The exit code.
    """
    options = parse_options(RepackOptions, "dataset repack", arguments)

    from dvr_jax.dataset.repack import repack_folder
    from dvr_jax.runtime.progress import Progress

    for folder in options.folders:
        with Progress(f"packing {folder}"):
            shards = list(repack_folder(folder))
        scenes = sum(len(shard.info.scenes) for shard in shards)
        before = sum(shard.bytes_before for shard in shards)
        after = sum(shard.bytes_after for shard in shards)
        print(
            f"{folder}: {scenes:,} scenes, {before:,} bytes before and {after:,} after, "
            f"{after / scenes:.0f} bytes a scene"
        )
    return 0


def _print_lengths(labels: LabelCounts) -> None:
    """Print in how many scenes the shortest solution has which length."""
    print("length of the shortest solution: scenes")

    for length, number in labels.shortest.items():
        fraction = number / labels.solved
        print(f"  {length:>2}: {number:>7,} ({fraction:5.1%}) {'#' * round(50 * fraction)}")


if __name__ == "__main__":
    run_command(main)
