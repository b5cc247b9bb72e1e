"""The figures of executed plans: how many succeed in physics, and why the others fail."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from dvr_jax.bench.committed import CommittedResults, RowsFile, describe_origins
from dvr_jax.bench.figure_cells import objects_in_words
from dvr_jax.bench.markdown import EMPTY, listing, percent, table
from dvr_jax.bench.paper import LENGTHS
from dvr_jax.execution.report import NO_DEVIATION


def execution(results: CommittedResults) -> str:
    """Table of executed scenes: how many of the solved ones succeed, by the number of actions."""
    files = results.executions()
    lengths = listing([str(length) for length in LENGTHS])
    head = ["scenes", "conditions", "executed", "succeed", f"succeed with {lengths} actions"]
    rows = [_row(file) for file in files]
    return f"{table(head, rows)}\n\n{describe_origins([file.origin for file in files])}"


def causes(results: CommittedResults) -> str:
    """Table of the causes of all failures."""
    failed = [
        row
        for file in results.executions()
        for row in file.rows
        if "succeeded" in row and not row["succeeded"]
    ]
    counts = Counter(str(row.get("cause", NO_DEVIATION)) for row in failed)
    return table(
        ["first cause of a failure", "failures"],
        [[cause, f"{count:,}"] for cause, count in counts.most_common()],
    )


def _row(file: RowsFile) -> list[str]:
    """One row of the table."""
    options = file.options
    executed = [row for row in file.rows if "succeeded" in row]
    by_length = [[row for row in executed if row["length"] == length] for length in LENGTHS]
    name = (
        f"{len(file.rows):,} of {objects_in_words(options['objects'], options['shape'])}, "
        f"seed {options['seed']}, `{options['search']}`"
    )
    if options["termination"] == "feasible":
        name += ", first feasible paths"
    low, high = options["friction"]
    friction = f"friction {low:g}" if low == high else f"friction {low:g} to {high:g}"
    noise = options["object_noise"]
    conditions = f"{friction}, objects displaced by {noise:g} mm" if noise else friction
    return [
        name,
        conditions,
        f"{len(executed):,}",
        _share(executed),
        listing([_share(rows) for rows in by_length]),
    ]


def _share(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how many of some executions succeed."""
    if not rows:
        return EMPTY
    succeeded = sum(bool(row["succeeded"]) for row in rows)
    return f"{succeeded:,} of {len(rows):,} ({percent(succeeded / len(rows))})"
