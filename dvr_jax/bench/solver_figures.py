"""Figures of the solver, of the data and of the networks: speed, recall, labels, peers, Table I, drawn links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dvr_jax.bench.committed import CommittedResults, describe_origins, metrics_origin
from dvr_jax.bench.label_statistics import count_verdicts, infeasible_share
from dvr_jax.bench.markdown import EMPTY, percent, ratio, table
from dvr_jax.bench.metrics import MetricsFile
from dvr_jax.bench.paper import DATASET, LENGTHS, TABLE_ONE, table_one_cell
from dvr_jax.bench.peer_statistics import COMPARISONS, Side, Times, compare_sides, describe_costs
from dvr_jax.bench.recall_metrics import ALL_LENGTHS, CHECKED, KINDS, PASSED, metric_name

TIME_UNITS = ("us/slice", "ms")
"""Units of the metrics that are written with a decimal."""

LABEL_ORDER = (
    "feasible",
    "infeasible by pose",
    "infeasible by sequence",
    "infeasible by path",
    "infeasible by check",
)
"""Order of the rows on labels: the cheapest bound first."""

NETWORKS = {
    "dvr_jax/networks/dvr": "network",
    "dvr_jax/networks/classifier": "classifier",
    "data/networks/faithful/dvr": "the paper's network",
}
"""Networks of the repository, without the ending of their files, and what they are called."""


def speed(results: CommittedResults) -> str:
    """Table of the solver's times."""
    file = results.metrics("speed")
    rows = []
    for metric in file.metrics:
        decimals = 1 if metric.unit in TIME_UNITS else 0
        rows.append([metric.metric, f"{metric.value:,.{decimals}f}", metric.unit])
    return f"{table(['what', 'median or count', 'unit'], rows)}\n\n{describe_origins([metrics_origin(file)])}"


def recall(results: CommittedResults) -> str:
    """Table of the solver's recall against 64 random starts, and the paths that pass the check."""
    file = results.metrics("recall")
    rows = []
    for kind in KINDS:
        oracle, ours, both = (
            _count(file, metric_name(kind, ALL_LENGTHS, name))
            for name in ("oracle", "ours", "both")
        )
        rows.append(
            [
                kind,
                f"{_count(file, metric_name(kind, ALL_LENGTHS, 'problems')):,}",
                f"{oracle:,}",
                f"{both:,} ({percent(both / oracle, 1) if oracle else EMPTY})",
                f"{ours - both:,}",
            ]
        )
    head = [
        "problems",
        "number",
        "feasible by 64 random starts",
        "of these found",
        "found besides",
    ]
    passed = f"Of {_count(file, CHECKED):,} feasible paths, {_count(file, PASSED):,} pass the independent check."
    return f"{table(head, rows)}\n\n{passed} {describe_origins([metrics_origin(file)])}"


def _count(file: MetricsFile, name: str) -> int:
    return round(file.value(name))


def table1(results: CommittedResults) -> str:
    """The paper's Table I as counted here, with the paper's number where it differs."""
    file = results.metrics("table1")
    right = 0
    rows = []
    for objects, published in TABLE_ONE.items():
        cells = []
        for length, paper in zip(LENGTHS, published, strict=True):
            count = _count(file, table_one_cell(objects, length))
            right += count == paper
            cells.append(f"{count:,}" if count == paper else f"{count:,} (paper: {paper:,})")
        rows.append([str(objects), *cells])

    head = ["objects", *(f"{length} actions" for length in LENGTHS)]
    cells_in_all = len(TABLE_ONE) * len(LENGTHS)
    return f"{table(head, rows)}\n\n{right} of {cells_in_all} cells are as in the paper (version {file.version})."


def labels(results: CommittedResults) -> str:
    """Table of random labels against 64 random starts."""
    file = results.rows("labels.jsonl")
    totals: Mapping[str, int] = file.header.get("totals", {})
    counts = count_verdicts(file.rows)
    rows = []
    for item in sorted(counts, key=lambda item: LABEL_ORDER.index(item.verdict)):
        total = f"{totals[item.verdict]:,}" if item.verdict in totals else EMPTY
        rows.append(
            [
                item.verdict,
                f"{item.confirmed} of {item.judged}",
                percent(item.share, 1),
                total,
            ]
        )

    sentences = []
    again = [row["planned again"] for row in file.rows if row["planned again"] is not None]
    if again:
        sentences.append(
            f"Feasible labels that the starts miss: {len(again)}; for {sum(again)} of them the planner finds a motion "
            "again that passes the check."
        )
    share = infeasible_share(counts, totals) if totals else None
    if share is not None:
        sentences.append(
            f"Weighted by the number of labels, {percent(share, 2)} of the infeasible ones hold."
        )
    sentences.append(describe_origins([file.origin]))

    head = ["label", "confirmed by 64 random starts", "share", "labels in the data"]
    return f"{table(head, rows)}\n\n{' '.join(sentences)}"


def peers(results: CommittedResults) -> str:
    """Table of the comparison with `robotic`: verdicts, median CPU times and paths that pass the check."""
    file = results.rows("peers.jsonl")
    problems = [problem for row in file.rows for problem in row["problems"]]
    rows = []
    for comparison in COMPARISONS:
        # A path is compared where at least one of the two has tried it.
        tried = [problem for problem in problems if problem[comparison.kind]]
        if all(comparison.ours not in problem[comparison.kind] for problem in tried):
            # Results of earlier versions have no optimal paths.
            continue
        sides = compare_sides(tried, comparison.kind, comparison.ours, comparison.theirs)
        is_path = comparison.kind == "path"
        rows.append(
            [
                comparison.title,
                f"{sides.problems}",
                f"{sides.both} / {sides.ours_alone} / {sides.theirs_alone}",
                _times(sides.feasible_times),
                _times(sides.infeasible_times),
                _passed(sides.our_solutions) if is_path else EMPTY,
                _passed(sides.their_solutions) if is_path else EMPTY,
                describe_costs(sides.cost_ratios) or EMPTY,
            ]
        )
    head = [
        "problems",
        "number",
        "feasible by both / ours alone / `robotic` alone",
        "ms where both feasible, ours / `robotic` (ratio)",
        "ms where both infeasible",
        "ours pass the check",
        "`robotic`'s pass",
        "cost not above `robotic`'s (median ratio)",
    ]
    sentence = (
        f"{len(file.rows)} scenes, `robotic` {file.options['robotic']}, medians of CPU times."
    )
    return f"{table(head, rows)}\n\n{sentence} {describe_origins([file.origin])}"


def _times(times: Times | None) -> str:
    if times is None:
        return EMPTY
    return f"{1e3 * times.ours:.0f} / {1e3 * times.theirs:,.0f} ({ratio(times.ratio)})"


def _passed(solutions: tuple[Side, ...]) -> str:
    return f"{sum(bool(side['passed']) for side in solutions)} of {len(solutions)}"


def drawn(results: CommittedResults) -> str:
    """Sentence on drawn links that get deeper into something than the check allows."""
    file = results.metrics("drawn")
    limit = file.value("penetration that the check allows")
    return (
        f"Of {_count(file, 'plans')} plans, {_count(file, 'plans with a link too deep')} have a drawn link deeper than "
        f"{limit:.0f} mm in something; the deepest is {file.value('deepest penetration'):.1f} mm. "
        f"{describe_origins([metrics_origin(file)])}"
    )


def dataset(results: CommittedResults) -> str:
    """Table of the training data beside the paper's, and the lengths of the shortest solutions."""
    file = results.metrics("dataset")
    rows = [[name, f"{_count(file, name):,}", f"{paper:,}"] for name, paper in DATASET.items()]

    solved = _count(file, "scenes with a solution")
    for metric in file.metrics:
        if metric.metric not in DATASET:
            rows.append(
                [
                    metric.metric,
                    f"{metric.value:,.0f} ({percent(metric.value / solved, 1)})",
                    EMPTY,
                ]
            )
    return table(["", "here", "the paper"], rows)


def networks(results: CommittedResults) -> str:
    """Table of the shipped networks: size, data, held-out figures and version."""
    rows = []
    for name, title in NETWORKS.items():
        manifest = results.manifest(f"{name}.json")
        held_out: Mapping[str, Any] = manifest["held_out"]
        rows.append(
            [
                title,
                f"`{name}.npz`",
                f"{manifest['parameters']:,}",
                f"{manifest['counts']['sequences']:,}",
                f"{held_out['step']:,}",
                _held_out(held_out, "validation/average_precision"),
                _held_out(held_out, "validation/top1"),
                manifest["versions"]["dvr_jax"],
            ]
        )
    head = [
        "network",
        "file",
        "parameters",
        "training sequences",
        "steps",
        "held-out average precision",
        "held-out first sequence right",
        "trained with version",
    ]
    return table(head, rows)


def _held_out(values: Mapping[str, Any], name: str) -> str:
    return f"{values[name]:.3f}" if name in values else EMPTY
