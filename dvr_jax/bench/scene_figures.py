"""The figure of sampled scenes of all kinds: how many each search solves, and how fast."""

from __future__ import annotations

from dvr_jax.bench.committed import CommittedResults, RowsFile, describe_origins
from dvr_jax.bench.figure_cells import (
    SEARCH_NAMES,
    cells_by_length,
    count_cell,
    groups_of,
    median_seconds_cell,
    objects_in_words,
)
from dvr_jax.bench.markdown import listing, table
from dvr_jax.bench.paper import LENGTHS


def scenes(results: CommittedResults) -> str:
    """Table of sampled scenes of all kinds: solved, exhausted, at the time limit, lengths and times."""
    files = sorted(
        results.scenes(),
        key=lambda file: (
            file.options["shape"],
            file.options["objects"],
            file.options.get("workcell", "facing"),
            file.options.get("fixed", [0, 0]),
            file.options["seed"],
            list(SEARCH_NAMES).index(file.options["search"]),
        ),
    )
    lengths = listing([str(length) for length in LENGTHS])
    head = [
        "scenes",
        "search",
        "solved",
        "pass the check",
        "tree exhausted",
        "time limit",
        f"plans of {lengths} actions",
        f"seconds, median, of {lengths} actions",
    ]
    mixed = len({file.origin.version for file in files}) > 1
    rows = [_scenes_row(file, mixed) for file in files]
    return f"{table(head, rows)}\n\n{describe_origins([file.origin for file in files])}"


def _scenes_row(file: RowsFile, name_version: bool) -> list[str]:
    """One row of the table of sampled scenes; it names the version where the rows come of several."""
    results = list(file.scene_results.values())
    solved_results = [result for result in results if result.solved]
    exhausted = sum(result.status == "tree exhausted" for result in results)
    groups = groups_of(file)
    options = file.options

    name = f"{len(results):,} of {objects_in_words(options['objects'], options['shape'])}, seed {options['seed']}"
    if options.get("workcell", "facing") != "facing":
        name = f"{name}, workcell `{options['workcell']}`"
    if options.get("fixed", [0, 0]) != [0, 0]:
        name = f"{name}, {options['fixed'][0]} to {options['fixed'][1]} fixed bodies"
    if name_version:
        name = f"{name} (version {file.origin.version})"
    return [
        name,
        f"`{options['search']}`",
        f"{len(solved_results):,}",
        f"{sum(result.passed for result in solved_results):,}",
        f"{exhausted:,}",
        f"{len(results) - len(solved_results) - exhausted:,}",
        listing([count_cell(groups[length]) for length in LENGTHS]),
        listing(cells_by_length(groups, median_seconds_cell)),
    ]
