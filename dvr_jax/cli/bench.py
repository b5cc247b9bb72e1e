"""Command line `python -m dvr_jax.bench NAME`: run one benchmark, or write the figures that benchmarks measured."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from dvr_jax.errors import DvrError, run_command
from dvr_jax.runtime.progress import Progress


@dataclass(frozen=True)
class Benchmark:
    """One benchmark of the command line."""

    module: str
    """Module of `dvr_jax.bench` whose function `run` takes the arguments and returns the exit code.

    It is imported only when it is needed, so that the list of benchmarks is there at once.
    """
    summary: str
    """One line for the list of benchmarks."""


BENCHMARKS: dict[str, Benchmark] = {
    "table1": Benchmark(
        "table_one", "the paper's Table I: number of sequences by objects and length"
    ),
    "scenes": Benchmark(
        "scenes", "plan sampled scenes by one search: solved share, lengths, times"
    ),
    "execute": Benchmark(
        "execute",
        "plan sampled scenes and execute the plans in physics: successes, causes of failure",
    ),
    "public": Benchmark("public", "scenes of public benchmarks: solved, seconds, actions, physics"),
    "chains": Benchmark(
        "chains", "random goals in succession, each from the scene that the last plan leaves"
    ),
    "motions": Benchmark(
        "motions",
        "plan sampled scenes and measure the motions: durations, limits, clearances of meshes",
    ),
    "search": Benchmark(
        "search", "plan the same scenes by several searches: the paper's main figures"
    ),
    "recall": Benchmark("recall", "the solver's verdicts against those of the frozen problems"),
    "oracle": Benchmark(
        "problem_drawing", "draw such problems, each judged from 64 random starts (hours)"
    ),
    "labels": Benchmark("labels", "labels of a sweep against 64 random starts (hours)"),
    "reasons": Benchmark(
        "reasons", "reasons of refuted sequences: the share of those that a changed scene confirms"
    ),
    "relaxation": Benchmark(
        "relaxation", "lower bounds on the number of actions beside the tree's verdicts"
    ),
    "unsolvable": Benchmark(
        "unsolvable",
        "seconds until the answer for scenes without a solution, beside earlier results",
    ),
    "needless": Benchmark(
        "needless", "plans of dvr with more actions than those of mbts, with and without --shortest"
    ),
    "dataset": Benchmark(
        "dataset", "labels and training targets of folders of shards, beside the paper's"
    ),
    "speed": Benchmark("speed", "times of a slice's system, of keyframes and of paths"),
    "startup": Benchmark(
        "startup", "what a machine's first plan compiles, and the time of the same plan again"
    ),
    "optimality": Benchmark(
        "optimality", "costs of optimized paths beside ten times the iterations (10 minutes)"
    ),
    "compare": Benchmark("compare", "those times of this checkout and of another one, in turn"),
    "drawn": Benchmark(
        "drawn", "how deep drawn links get into what plans keep their capsules clear of"
    ),
    "peers": Benchmark("peers", "the same problems solved by `robotic`"),
    "fuzz": Benchmark(
        "fuzz",
        "read damaged scenes and files, run random command lines: nothing may break (10 minutes)",
    ),
    "report": Benchmark(
        "report", "write the figures in README.md and docs/ from the committed results"
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark that is named.

    Args:
        arguments: name and options of the benchmark; by default those of the process.

    Returns:
        The exit code.

    Raises:
        DvrError: There is no benchmark of this name.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)

    if not given or given[0] in ("-h", "--help"):
        print_help()
        return 0

    name = given[0]
    if name not in BENCHMARKS:
        raise DvrError(f"there is no benchmark '{name}'; valid: {', '.join(BENCHMARKS)}.")

    benchmark = BENCHMARKS[name]
    module = importlib.import_module(f"dvr_jax.bench.{benchmark.module}")
    with Progress(f"benchmark {name}"):
        exit_code: int = module.run(given[1:])
    return exit_code


def print_help() -> None:
    """Print the list of benchmarks."""
    print(
        "usage: python -m dvr_jax.bench NAME [OPTIONS]; NAME --help lists a benchmark's options\n"
    )
    for name, benchmark in BENCHMARKS.items():
        print(f"  {name:<8} {benchmark.summary}")


if __name__ == "__main__":
    run_command(main)
