"""Command line `python -m dvr_jax.bench NAME`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from dvr_jax.bench import drawn, labels, peers, recall, scenes, search, speed, table_one
from dvr_jax.errors import DvrError, run_command

BENCHMARKS: dict[str, tuple[Callable[[list[str]], int], str]] = {
    "table1": (table_one.run, "the paper's Table I: number of sequences by objects and length"),
    "scenes": (scenes.run, "plan sampled scenes by one search: solved share, lengths, times"),
    "search": (search.run, "plan the same scenes by several searches: the paper's main figures"),
    "recall": (recall.run, "the solver's verdicts against those of the frozen problems in bench/"),
    "oracle": (recall.run_oracle, "draw such problems, each judged from 64 random starts (hours)"),
    "labels": (labels.run, "labels of a sweep against 64 random starts (hours)"),
    "speed": (speed.run, "times of a slice's system, of keyframes and of paths"),
    "drawn": (drawn.run, "how deep drawn links get into what plans keep their capsules clear of"),
    "peers": (peers.run, "the same problems solved by `robotic`"),
}


def main() -> int:
    """Run the benchmark that is named."""
    if sys.argv[1:2] in ([], ["-h"], ["--help"]):
        print("usage: python -m dvr_jax.bench NAME [OPTIONS]; NAME --help lists a benchmark's options\n")
        print("\n".join(f"  {name:<8} {line}" for name, (_, line) in BENCHMARKS.items()))
        return 0
    name = sys.argv[1]
    if name not in BENCHMARKS:
        raise DvrError(f"there is no benchmark '{name}'; valid: {', '.join(BENCHMARKS)}.")
    return BENCHMARKS[name][0](sys.argv[2:])


if __name__ == "__main__":
    run_command(main)
