"""Figures of the searches: the paper's main comparison, and sampled scenes of other kinds."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from dvr_jax.bench.committed import CommittedResults, Origin, RowsFile, describe_origins
from dvr_jax.bench.figure_cells import (
    SEARCH_NAMES,
    cells_by_length,
    count_cell,
    groups_of,
    median_seconds_cell,
    objects_in_words,
)
from dvr_jax.bench.markdown import EMPTY, percent, ratio, table
from dvr_jax.bench.paper import (
    FEASIBLE_SCENES,
    LENGTHS,
    MEDIAN_PATH_NLPS,
    MEDIAN_SECONDS,
    SPEED_UP,
    UNSOLVED,
)
from dvr_jax.bench.scene_result import SceneResult, group_by_length
from dvr_jax.bench.search_statistics import (
    compare_lengths,
    count_feasible,
    first_right_share,
    speed_ups,
    stage_share,
)

SEARCH_PHRASES = {
    "dvr": "the network",
    "classifier": "the classifier",
    "mbts": "multi-bound tree search",
}
"""What each search is called within a sentence."""

COMPARED = ("dvr", "classifier", "mbts")
"""Searches of the main comparison."""


LENGTH_HEAD = ("actions of the plan", *map(str, LENGTHS))
"""Head of the tables by length."""


def _search_files(results: CommittedResults) -> dict[str, RowsFile]:
    return {name: results.rows(f"search/{name}.jsonl") for name in COMPARED}


def _origins(files: Sequence[RowsFile]) -> list[Origin]:
    return [file.origin for file in files]


def _median_paths(results: list[SceneResult]) -> str:
    return f"{statistics.median(result.path_nlps for result in results):g}"


def _mean_paths(results: list[SceneResult]) -> str:
    return f"{statistics.mean(result.path_nlps for result in results):.2f}"


def _mean_proposed(results: list[SceneResult]) -> str:
    return f"{statistics.mean(result.sequences_proposed for result in results):.2f}"


def _first_right(results: list[SceneResult]) -> str:
    return percent(first_right_share(results))


def _speed_up_cells(files: dict[str, RowsFile]) -> list[str]:
    """Median speed-up of the network over multi-bound tree search at each length."""
    cells = []
    for length in LENGTHS:
        ratios = speed_ups(files["dvr"].scene_results, files["mbts"].scene_results, length)
        cells.append(ratio(statistics.median(ratios)) if ratios else EMPTY)
    return cells


def headline(results: CommittedResults) -> str:
    """Short table beside the paper: seconds, path NLPs and speed-up by length, and the scenes solved."""
    files = _search_files(results)
    groups = groups_of(files["dvr"])
    rows = [
        [
            "seconds from image to checked motion (median)",
            *cells_by_length(groups, median_seconds_cell),
        ],
        _paper_row(MEDIAN_SECONDS),
        ["path NLPs solved (median)", *cells_by_length(groups, _median_paths)],
        _paper_row(MEDIAN_PATH_NLPS),
        ["speed-up over multi-bound tree search (median)", *_speed_up_cells(files)],
        _paper_row(SPEED_UP),
    ]
    paper = f"{FEASIBLE_SCENES - UNSOLVED['dvr']:,} of {FEASIBLE_SCENES:,}"
    solved_line = f"Feasible scenes solved: {solved(results)} (paper: {paper})."
    return f"{table(LENGTH_HEAD, rows)}\n\n{solved_line} {describe_origins(_origins(list(files.values())))}"


def solved(results: CommittedResults) -> str:
    """Feasible scenes that the network solves, of all feasible ones, inline."""
    files = _search_files(results)
    tables = [file.scene_results for file in files.values()]
    number = sum(result.solved for result in files["dvr"].scene_results.values())
    return f"{number:,} of {count_feasible(tables):,}"


def search_scenes(results: CommittedResults) -> str:
    """Number of scenes of the main comparison, inline."""
    return f"{len(results.rows('search/dvr.jsonl').rows):,}"


def search_version(results: CommittedResults) -> str:
    """Version that measured the main comparison, inline."""
    return results.rows("search/dvr.jsonl").origin.version


def search_table(results: CommittedResults) -> str:
    """Table of the main comparison by length, for all searches, beside the paper."""
    files = _search_files(results)
    rows = []
    for name, file in files.items():
        groups = groups_of(file)
        title = SEARCH_NAMES[name]
        rows.append([f"{title}: scenes", *cells_by_length(groups, count_cell)])
        rows.append([f"{title}: seconds, median", *cells_by_length(groups, median_seconds_cell)])

        # The number of proposals and of NLPs is what the network is for.
        if name == "dvr":
            rows += _network_rows(title, groups)

    speed_up = "speed-up of the network over multi-bound tree search, same length by both, median"
    rows.append([speed_up, *_speed_up_cells(files)])
    rows.append(_paper_row(SPEED_UP))

    return f"{table(LENGTH_HEAD, rows)}\n\n{describe_origins(_origins(list(files.values())))}"


def _network_rows(title: str, groups: dict[int, list[SceneResult]]) -> list[list[str]]:
    """Rows of the main comparison that only the network has."""
    return [
        _paper_row(MEDIAN_SECONDS),
        [f"{title}: path NLPs, median", *cells_by_length(groups, _median_paths)],
        _paper_row(MEDIAN_PATH_NLPS),
        [f"{title}: path NLPs, mean", *cells_by_length(groups, _mean_paths)],
        [f"{title}: sequences proposed, mean", *cells_by_length(groups, _mean_proposed)],
        [f"{title}: the first sequence proposed is right", *cells_by_length(groups, _first_right)],
    ]


def _paper_row(values: Mapping[int, object]) -> list[str]:
    """Row of the paper's values by length, as far as it gives them."""
    return ["… in the paper", *(str(values.get(length, EMPTY)) for length in LENGTHS)]


def search_summary(results: CommittedResults) -> str:
    """Sentences on the main comparison: scenes solved, shares of the time, longer plans, unsolved scenes, all times."""
    files = _search_files(results)
    tables = {name: file.scene_results for name, file in files.items()}
    feasible = count_feasible(list(tables.values()))

    options = files["dvr"].options
    solved_by = [
        f"{_number_solved(file):,} by {SEARCH_PHRASES[name]}" for name, file in files.items()
    ]
    lines = [
        f"- {len(tables['dvr']):,} scenes of {objects_in_words(options['objects'], options['shape'])} "
        f"(seed {options['seed']}), {options['time_limit']:g} s each. "
        f"Solved of the {feasible:,} scenes that some search solves: {', '.join(solved_by)}."
    ]

    solved_results = [result for result in tables["dvr"].values() if result.solved]
    network = percent(stage_share(solved_results, "network"), 1)
    image = percent(stage_share(solved_results, "image"), 1)
    lines.append(
        f"- Of the time in solved scenes, the network takes {network}, the depth image {image}."
    )

    lengths = compare_lengths(tables["dvr"], tables["mbts"])
    lines.append(
        f"- Of the {lengths.both:,} scenes that both solve, the network's plan has more actions than that of "
        f"multi-bound tree search in {lengths.longer}, fewer in {lengths.shorter}."
    )

    lines.append(f"- Scenes without a plan take {_join_medians(files)} (median).")
    totals = []
    for name, file in files.items():
        total = sum(result.total_seconds for result in file.scene_results.values())
        totals.append(f"{total:,.0f} s by {SEARCH_PHRASES[name]}")
    lines.append(f"- All scenes together take {', '.join(totals)}.")
    return "\n".join([*lines, "", describe_origins(_origins(list(files.values())))])


def _number_solved(file: RowsFile) -> int:
    return sum(result.solved for result in file.scene_results.values())


def _join_medians(files: dict[str, RowsFile]) -> str:
    """Median seconds of the scenes that each search leaves without a plan."""
    parts = []
    for name, file in files.items():
        unsolved = [result for result in file.scene_results.values() if not result.solved]
        if unsolved:
            parts.append(f"{median_seconds_cell(unsolved)} s by {SEARCH_PHRASES[name]}")
    return ", ".join(parts) or "no time, since there are none,"


def search_faithful(results: CommittedResults) -> str:
    """Table of the paper's network beside the shipped one, on the same scenes."""
    faithful = results.rows("faithful/dvr.jsonl")
    shipped = results.rows("search/dvr.jsonl")
    number = len(faithful.rows)
    first_scenes = [result for scene, result in shipped.scene_results.items() if scene < number]

    networks = {
        "the paper's network": list(faithful.scene_results.values()),
        "the shipped network": first_scenes,
    }
    rows = []
    for title, found in networks.items():
        groups = group_by_length(found, max(LENGTHS))
        rows.append([f"{title}: scenes", *cells_by_length(groups, count_cell)])
        rows.append(
            [
                f"{title}: the first sequence proposed is right",
                *cells_by_length(groups, _first_right),
            ]
        )
        rows.append([f"{title}: seconds, median", *cells_by_length(groups, median_seconds_cell)])

    head = [f"first {number:,} scenes, actions of the plan", *map(str, LENGTHS)]
    return f"{table(head, rows)}\n\n{describe_origins([faithful.origin, shipped.origin])}"
