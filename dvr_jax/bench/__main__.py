"""Command line `python -m dvr_jax.bench NAME`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from dvr_jax.bench import labels, peers, recall, scenes, search, speed, table_one
from dvr_jax.errors import DvrError, run_command

BENCHMARKS: dict[str, Callable[[list[str]], int]] = {
    "table1": table_one.run,
    "scenes": scenes.run,
    "oracle": recall.run_oracle,
    "recall": recall.run,
    "labels": labels.run,
    "search": search.run,
    "speed": speed.run,
    "peers": peers.run,
}


def main() -> int:
    """Run the benchmark that is named."""
    if sys.argv[1:2] in ([], ["-h"], ["--help"]):
        print("usage: python -m dvr_jax.bench NAME\n" + "\n".join(f"  {name}" for name in BENCHMARKS))
        return 0
    name = sys.argv[1]
    if name not in BENCHMARKS:
        raise DvrError(f"there is no benchmark '{name}'; valid: {', '.join(BENCHMARKS)}.")
    return BENCHMARKS[name](sys.argv[2:])


if __name__ == "__main__":
    run_command(main)
