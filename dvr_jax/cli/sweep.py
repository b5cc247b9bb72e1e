"""Command line `python -m dvr_jax.sweep --scenes FILE.jsonl --out DIR`: label action sequences of many scenes.

Shards are labeled by processes of this machine or, with `--ray ADDRESS`, by the machines of a Ray cluster on which this
package is installed. They are written here in both cases.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dvr_jax.cli.options import LARGEST, LARGEST_NUMBER, parse_options, require_range
from dvr_jax.errors import OptionError, run_command


@dataclass(frozen=True)
class SweepOptions:
    """Label sequences of each scene, in order of length, until enough of them are feasible.

    A sweep that was stopped goes on when the same command is given again. The labels of each scene are kept at once,
    and a shard is written once its scenes are complete.
    """

    scenes: Path
    """JSON Lines file, one scene a line (`python -m dvr_jax.sample` draws them)."""
    out: Path
    """Folder of the shards; shards that it holds are kept."""
    solutions: int = 4
    """Number of feasible sequences after which a scene is done."""
    leaves: int = 1000
    """Number of sequences that reach the goal and that the pose bound does not refute, after which a scene is done."""
    k_max: int = 6
    """Largest number of actions."""
    seed: int = 0
    """Seed of the solver's samples."""
    shard: int = 50
    """Number of scenes in a shard. Progress is reported, and kept, scene by scene."""
    width: int = 32
    """Number of scenes whose solves share a batch."""
    workers: int = os.cpu_count() or 1
    """Number of processes, which label one shard each at a time, or a part of it if there are fewer shards."""
    ray: str | None = None
    """Address of a Ray cluster ("auto": the one that runs on this machine), whose CPUs take the workers' place."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            OptionError: A number is too small or too large.
        """
        for name in ("solutions", "leaves", "k_max", "shard", "width", "workers"):
            require_range(name, getattr(self, name), 1, LARGEST.get(name, LARGEST_NUMBER))

        if self.seed < 0:
            raise OptionError(f"--seed is {self.seed}; valid is 0 or more.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Label the scenes of a file.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    options = parse_options(SweepOptions, "sweep", arguments)
    options.check()

    from dvr_jax.dataset.labelling import LabelOptions
    from dvr_jax.planning.sweep import Sweep, sweep

    request = Sweep(
        scenes=options.scenes,
        out=options.out,
        labelling=LabelOptions(options.solutions, options.leaves, options.k_max, options.seed),
        shard=options.shard,
        width=options.width,
        workers=options.workers,
        ray=options.ray,
    )
    given = sys.argv[1:] if arguments is None else arguments
    sweep(request, command=["python", "-m", "dvr_jax.sweep", *given])

    print(
        f"labels written to {options.out}/; `python -m dvr_jax.dataset {options.out}` counts them"
    )
    return 0


if __name__ == "__main__":
    run_command(main)
