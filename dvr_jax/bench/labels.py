"""Labels of a sweep against an oracle of 64 random starts.

Are sequences that are labeled infeasible infeasible, and are those labeled feasible feasible? The oracle judges under
the bounds that the label speaks of, and confirms the label if it comes to the same verdict:

- Of a label that the pose or the sequence bound refutes, no start finds feasible keyframes of the prefix. The oracle
  always takes the whole scene. The pose bound asks for less, so what it refutes is refuted more surely.
- Of a label that is feasible, or refuted by its path or by the check, the oracle also looks for a path that the check
  accepts.

A feasible label that the oracle misses is planned again, and holds if the check accepts that motion.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections import Counter
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.label_statistics import count_verdicts, infeasible_share
from dvr_jax.bench.oracle import oracle_keyframes, oracle_path
from dvr_jax.bench.results_file import ResultsFile, Row
from dvr_jax.checker.replay import check_motion
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import find_shards, read_shard
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.planning.feasibility import feasibility
from dvr_jax.planning.path_motion import interpolate
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.types import Scene
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.workcell.model import workcell_model

FEASIBLE_KEYFRAMES = 8
"""Feasible keyframes from which the oracle starts its paths."""

DRAWN_BOUNDS = ("", "pose", "sequence", "path", "check")
"""Bounds whose labels are drawn; a feasible label has none."""


@dataclass(frozen=True)
class LabelsOptions:
    """Judge random labels again, with an oracle of 64 random starts."""

    data: tuple[Path, ...]
    """Folders of shards."""
    labels: int = 300
    """Feasible labels, and infeasible ones of each bound: nearly all are refuted by the pose bound. Those that a
    constant of the scene refutes are left out."""
    seed: int = 0
    """Of the draw and of the starts."""
    workers: int = os.cpu_count() or 1
    """Processes, one label each at a time."""
    out: Path | None = None
    """JSON Lines file of results; labels that it already has are not judged again."""


@dataclass(frozen=True)
class Drawn:
    """One label of a draw."""

    folder: str
    """The sweep's."""
    scene: Scene
    """What the label is about."""
    label: Label
    """The verdict on one sequence."""

    @property
    def verdict(self) -> str:
        """The label's, and the bound that refutes it."""
        return "feasible" if self.label.feasible else f"infeasible by {self.label.bound}"


def oracle_verdict(scene: Scene, label: Label, generator: np.random.Generator) -> bool:
    """Decide by 64 random starts whether a label's sequence is feasible, under the bounds that the label speaks of.

    Args:
        scene: the label's scene.
        label: the label.
        generator: of the starts.

    Returns:
        Whether some start is feasible.
    """
    actions = [Action.parse(text) for text in label.actions]
    needs_path = label.feasible or label.bound in ("path", "check")
    enough = FEASIBLE_KEYFRAMES if needs_path else 1
    found = oracle_keyframes(scene, actions, generator, enough)
    if not (found and needs_path):
        return bool(found)

    problem = transcribe(scene, actions)

    def accept(path: NlpSolution) -> bool:
        motion = interpolate(scene, problem, path.q, path.m)
        return check_motion(scene, actions, motion).passed

    return oracle_path(workcell_model(scene.workcell), problem, found, generator, accept)


def draw_labels(options: LabelsOptions) -> tuple[list[Drawn], Counter[str]]:
    """Draw as many labels of each verdict and bound, the feasible ones first, and count how many there are of each."""
    generator = np.random.default_rng(options.seed)
    drawn: dict[str, list[tuple[float, Drawn]]] = {bound: [] for bound in DRAWN_BOUNDS}
    counts: Counter[str] = Counter()

    # Each label gets a random key. Those with the smallest keys are a uniform draw, and few labels are held at a time.
    for info in find_shards(options.data):
        shard = read_shard(info.path)
        keys = generator.random(len(shard.labels))
        for key, label in zip(keys.tolist(), shard.labels, strict=True):
            if label.bound == "symbolic":
                continue
            scene = shard.scenes[label.scene - info.scenes.start]
            item = Drawn(info.path.parent.name, scene, label)
            counts[item.verdict] += 1
            drawn[label.bound].append((key, item))

        for rows in drawn.values():
            rows.sort(key=itemgetter(0))
            del rows[options.labels :]

    return [item for rows in drawn.values() for _, item in rows], counts


def run(arguments: list[str]) -> int:
    """Print the confirmed share by verdict and bound."""
    options = tyro.cli(LabelsOptions, prog="python -m dvr_jax.bench labels", args=arguments)
    if options.labels < 1 or options.workers < 1 or options.seed < 0:
        raise DvrError("--labels and --workers are 1 or more, --seed is 0 or more.")

    drawn, totals = draw_labels(options)

    # The checksum ties the rows to this very draw from these very labels.
    checksum = hashlib.sha256(
        repr([(item.folder, item.label) for item in drawn]).encode()
    ).hexdigest()[:16]
    header = {"labels": options.labels, "seed": options.seed, "drawn": checksum}
    results = ResultsFile(options.out, header, of="label", facts={"totals": dict(totals)})

    todo = results.missing(len(drawn))
    with worker_processes(options.workers) as pool:
        judge = partial(_judge, options.seed)
        futures = [pool.submit(judge, number, drawn[number]) for number in todo]
        for future in as_completed(futures):
            row = future.result()
            results.add(row)
            if not row["confirmed"]:
                _print_refuted(row)

    _print_table(list(results.rows.values()), totals)
    return 0


def _judge(seed: int, number: int, drawn: Drawn) -> Row:
    """Give the results row of one label."""
    label = drawn.label
    with jax.enable_x64(True):
        verdict = oracle_verdict(drawn.scene, label, np.random.default_rng([seed, number]))

    planned_again = None
    if label.feasible and not verdict:
        (again,) = feasibility(drawn.scene, [label.actions])
        planned_again = again.feasible

    return {
        "label": number,
        "folder": drawn.folder,
        "scene": label.scene,
        "actions": label.actions,
        "verdict": drawn.verdict,
        "violation": label.violation,
        "confirmed": verdict == label.feasible,
        "planned again": planned_again,
    }


def _print_refuted(row: Row) -> None:
    actions = " ".join(row["actions"])
    print(
        f"  not confirmed, {row['verdict']}: scene {row['scene']} of {row['folder']}, {actions}",
        file=sys.stderr,
        flush=True,
    )


def _print_table(rows: list[Row], totals: Counter[str]) -> None:
    for counts in count_verdicts(rows):
        judged = f"{counts.confirmed:>5} of {counts.judged:>5}"
        print(
            f"{counts.verdict:<24} {judged} confirmed ({counts.share:.1%}), of {totals[counts.verdict]:,} labels"
        )

    again = [row["planned again"] for row in rows if row["planned again"] is not None]
    if again:
        missed = f"of the {len(again)} feasible ones that the oracle misses"
        print(f"{missed}, {sum(again)} are planned again and pass the check")

    share = infeasible_share(count_verdicts(rows), totals)
    if share is not None:
        print(f"infeasible, by the number of labels of each bound: {share:.2%}")
