"""The paper's main figures on held-out scenes: total time and NLPs solved by length of the solution, for the network,
the feasibility classifier and multi-bound tree search.

Writes for each search `NAME.jsonl` (resumable), and `search.png` with the box plots of figures 5 to 7 of the paper."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from dvr_jax.bench.scenes import ScenesOptions, results
from dvr_jax.errors import DvrError
from dvr_jax.model.predictor import SHIPPED
from dvr_jax.search.searches import GUIDED, SEARCHES

Row = dict[str, Any]


@dataclass(frozen=True)
class SearchOptions:
    """Solve the same scenes by several searches and compare them."""

    out: Path
    """Folder for results and plots; what it already has is not computed again."""
    searches: tuple[str, ...] = ("dvr", "classifier", "mbts")
    """Of dvr, classifier, mbts, bfs."""
    networks: Path = SHIPPED
    """Folder with a network NAME.npz for each of the guided searches (`network.npz` of a training, renamed); by default
    the shipped ones."""
    number: int = 500
    """Scenes."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    seed: int = 2
    """Of the scenes. The shipped networks were trained on seeds 100 to 102."""
    k_max: int = 6
    """Largest number of actions."""
    time_limit: float = 60.0
    """For each scene and search [s]."""
    workers: int = ScenesOptions.workers
    """Processes, one scene each at a time."""


def total(row: Row) -> float:
    """Seconds from image to checked motion."""
    return float(row["seconds"]["total"])


def paths(row: Row) -> int:
    """Path NLPs solved; every start counts."""
    return int(row["nlps"].get("path", 0))


def leaves(row: Row) -> int:
    """Sequences whose path was tried."""
    return int(row["verdicts"].get("path", 0))


def proposed(row: Row) -> int:
    """Sequences that reach the goal and were considered, those that a bound of keyframes refuted included: NLPs where
    each is solved as one path."""
    return int(row["verdicts"].get("leaf", 0))


def keyframes(row: Row) -> int:
    """Keyframe NLPs solved, of whole prefixes and of single objects."""
    return int(row["nlps"].get("sequence", 0)) + int(row["nlps"].get("pose", 0))


def by_length(rows: Sequence[Row], k_max: int) -> dict[int, list[Row]]:
    """NlpSolution rows by number of actions."""
    return {length: [row for row in rows if len(row["words"]) == length] for length in range(1, k_max + 1)}


def _median(rows: Sequence[Row], value: Callable[[Row], float]) -> str:
    return f"{statistics.median(map(value, rows)):.3g}" if rows else "-"


def _print_search(name: str, rows: Sequence[Row], feasible: int, k_max: int) -> None:
    solved = [row for row in rows if row["words"]]
    image, network, seconds = (
        sum(row["seconds"].get(part, 0.0) for row in solved) for part in ("image", "network", "total")
    )
    share = f"; of the time, network {network / seconds:.1%}, its depth image {image / seconds:.1%}" if network else ""
    print(f"{name}: {len(solved)} solved, {feasible - len(solved)} of the {feasible} feasible scenes not{share}")
    print(
        "  length scenes   total s   first right   proposed   paths tried   path NLPs   keyframe NLPs (medians; means)"
    )
    for length, of_length in by_length(solved, k_max).items():
        if of_length:
            first = sum(proposed(row) == 1 for row in of_length) / len(of_length)
            columns = " ".join(
                f"{_median(of_length, value)}; {statistics.mean(map(value, of_length)):<8.3g}".rjust(13)
                for value in (proposed, leaves, paths, keyframes)
            )
            print(f"  {length:>6} {len(of_length):>6} {_median(of_length, total):>9} {first:>12.0%} {columns}")
    others = [row for row in rows if not row["words"]]
    print(
        f"  unsolved {len(others):>4} {_median(others, total):>9}   all scenes together: {sum(map(total, rows)):.0f} s"
    )


def _print_speed_up(names: Sequence[str], tables: dict[str, dict[int, Row]], k_max: int) -> None:
    for name in names:
        if name == "mbts" or "mbts" not in tables:
            continue
        print(f"speed-up of {name} over mbts, scenes where both found the same length: median")
        for length in range(1, k_max + 1):
            ratios = [
                total(tables["mbts"][index]) / total(row)
                for index, row in tables[name].items()
                if len(row["words"]) == length and len(tables["mbts"][index]["words"]) == length
            ]
            if ratios:
                print(f"  {length:>6} {len(ratios):>6} scenes {statistics.median(ratios):>8.1f}x")
        lengths = [
            (len(row["words"]), len(tables["mbts"][index]["words"]))
            for index, row in tables[name].items()
            if row["words"] and tables["mbts"][index]["words"]
        ]
        longer, shorter = sum(ours > theirs for ours, theirs in lengths), sum(ours < theirs for ours, theirs in lengths)
        print(f"  of {len(lengths)} solved by both, {name}'s solution has more actions in {longer}, fewer in {shorter}")


def save_plots(path: Path, tables: dict[str, dict[int, Row]], k_max: int) -> None:
    """Box plots of total time, sequences proposed, path NLPs and keyframe NLPs by length, one colour a search."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise DvrError("the plots need matplotlib: pip install '.[plots]' in the repository.") from None
    figure = Figure(figsize=(17, 4), layout="constrained")
    lengths = [n for n in range(1, k_max + 1) if any(len(r["words"]) == n for t in tables.values() for r in t.values())]
    values: list[tuple[str, str, Callable[[Row], float]]] = [
        ("total time [s]", "log", total),
        ("sequences proposed", "log", proposed),
        ("path NLPs solved", "linear", paths),
        ("keyframe NLPs solved", "symlog", keyframes),
    ]
    for axes, (label, scale, value) in zip(figure.subplots(1, len(values)), values, strict=True):
        width = 0.8 / len(tables)
        for i, (name, table) in enumerate(tables.items()):
            grouped = by_length(list(table.values()), k_max)
            shown = [length for length in lengths if grouped[length]]
            boxes = axes.boxplot(
                [[value(row) for row in grouped[length]] for length in shown],
                positions=[length + (i - (len(tables) - 1) / 2) * width for length in shown],
                widths=0.8 * width,
                patch_artist=True,
                manage_ticks=False,
                flierprops={"markersize": 2},
            )
            for box in boxes["boxes"]:
                box.set_facecolor(f"C{i}")
            axes.plot([], [], color=f"C{i}", linewidth=6, label=name)
        axes.set(xlabel="actions of the solution", ylabel=label, yscale=scale, xticks=lengths)
        axes.legend()
    figure.savefig(path, dpi=110)


def run(arguments: list[str]) -> int:
    """Solve, print the tables, plot."""
    options = tyro.cli(SearchOptions, prog="python -m dvr_jax.bench search", args=arguments)
    common = ScenesOptions(
        number=options.number,
        objects=options.objects,
        seed=options.seed,
        k_max=options.k_max,
        time_limit=options.time_limit,
        workers=options.workers,
    )
    if not options.searches:
        raise DvrError(f"--searches names none; valid are {', '.join(SEARCHES)}.")
    tables: dict[str, dict[int, Row]] = {}
    for name in options.searches:
        network = options.networks / f"{name}.npz" if name in GUIDED else None
        chosen = replace(common, search=name, network=network, out=options.out / f"{name}.jsonl")
        rows: list[Any] = list(results(chosen))
        tables[name] = {int(row["scene"]): row for row in sorted(rows, key=lambda row: int(row["scene"]))}
    feasible = sum(any(table[i]["words"] for table in tables.values()) for i in range(options.number))
    print(f"{options.number} scenes of {options.objects} objects (seed {options.seed}), {options.time_limit:g} s each")
    for name, table in tables.items():
        _print_search(name, list(table.values()), feasible, options.k_max)
    _print_speed_up(options.searches, tables, options.k_max)
    save_plots(options.out / "search.png", tables, options.k_max)
    return 0
