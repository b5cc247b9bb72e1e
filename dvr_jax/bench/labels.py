"""Labels of a sweep against an oracle of 64 random starts: are infeasible rows infeasible, and feasible ones feasible?

A row is confirmed if the oracle, under the bounds that the label speaks of, comes to the same verdict: of a row that
the pose or the sequence bound refutes, no start finds feasible keyframes of the prefix (of the whole scene; the pose
bound asks less and refutes more surely); of one that is feasible, or refuted by its path or the check, the oracle looks
for a path too that the check accepts. A feasible label that the oracle misses is planned again, and holds if the check
accepts that motion."""

from __future__ import annotations

import hashlib
import os
import sys
from collections import Counter, defaultdict
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.recall import oracle_keyframes, oracle_path
from dvr_jax.bench.results_file import ResultsFile
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
from dvr_jax.solver.engine import NlpSolution


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


def oracle_verdict(scene: Scene, label: Label, generator: np.random.Generator) -> bool:
    """Whether some of 64 random starts is feasible, under the bounds that the label speaks of."""
    actions = [Action.parse(text) for text in label.actions]
    needs_path = label.feasible or label.bound in ("path", "check")
    found = oracle_keyframes(scene, actions, generator, enough=8 if needs_path else 1)
    if not (found and needs_path):
        return bool(found)
    problem = transcribe(scene, actions)

    def accept(path: NlpSolution) -> bool:
        return check_motion(scene, actions, interpolate(scene, problem, path.q, path.m)).passed

    return oracle_path(problem, found, generator, accept)


@dataclass(frozen=True)
class Drawn:
    """One label of a draw."""

    folder: str
    """The sweep's."""
    scene: Scene
    label: Label

    @property
    def verdict(self) -> str:
        """The label's, and the bound that refutes it."""
        return "feasible" if self.label.feasible else f"infeasible by {self.label.bound}"


def draw_labels(options: LabelsOptions) -> tuple[list[Drawn], Counter[str]]:
    """As many labels of each verdict and bound, the feasible ones first; and how many there are of each."""
    generator = np.random.default_rng(options.seed)
    drawn: dict[str, list[tuple[float, Drawn]]] = {bound: [] for bound in ("", "pose", "sequence", "path", "check")}
    counts: Counter[str] = Counter()
    for info in find_shards(options.data):
        shard = read_shard(info.path)
        keys = generator.random(len(shard.labels))
        # Those of the smallest keys are a uniform draw, and few labels have to be held at a time.
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


def _judge(seed: int, number: int, drawn: Drawn) -> dict[str, object]:
    label = drawn.label
    with jax.enable_x64(True):
        verdict = oracle_verdict(drawn.scene, label, np.random.default_rng([seed, number]))
    missed = label.feasible and not verdict
    (again,) = feasibility(drawn.scene, [label.actions]) if missed else (None,)
    return {
        "label": number,
        "folder": drawn.folder,
        "scene": label.scene,
        "actions": label.actions,
        "verdict": drawn.verdict,
        "violation": label.violation,
        "confirmed": verdict == label.feasible,
        "planned again": None if again is None else again.feasible,
    }


def run(arguments: list[str]) -> int:
    """Print the confirmed share by verdict and bound."""
    options = tyro.cli(LabelsOptions, prog="python -m dvr_jax.bench labels", args=arguments)
    if options.labels < 1 or options.workers < 1 or options.seed < 0:
        raise DvrError("--labels and --workers are 1 or more, --seed is 0 or more.")
    drawn, totals = draw_labels(options)
    checksum = hashlib.sha256(repr([(item.folder, item.label) for item in drawn]).encode()).hexdigest()[:16]
    ledger = ResultsFile(options.out, {"labels": options.labels, "seed": options.seed, "drawn": checksum}, of="label")
    todo = ledger.missing(len(drawn))
    with worker_processes(options.workers) as pool:
        judge = partial(_judge, options.seed)
        for future in as_completed([pool.submit(judge, number, drawn[number]) for number in todo]):
            row = future.result()
            ledger.add(row)
            if not row["confirmed"]:
                words = " ".join(row["actions"])  # type: ignore[arg-type]
                place = f"scene {row['scene']} of {row['folder']}"
                print(f"  not confirmed, {row['verdict']}: {place}, {words}", file=sys.stderr, flush=True)
    again = [row["planned again"] for row in ledger.rows.values() if row["planned again"] is not None]
    rows: dict[str, list[bool]] = defaultdict(list)
    for kept in ledger.rows.values():
        rows[kept["verdict"]].append(kept["confirmed"])
    shares = {name: float(np.mean(verdicts)) for name, verdicts in sorted(rows.items())}
    for name, share in shares.items():
        judged = f"{sum(rows[name]):>5} of {len(rows[name]):>5}"
        print(f"{name:<24} {judged} confirmed ({share:.1%}), of {totals[name]:,} labels")
    if again:
        missed = f"of the {len(again)} feasible ones that the oracle misses"
        print(f"{missed}, {sum(again)} are planned again and pass the check")
    refuted = [name for name in shares if name != "feasible"]
    if refuted:
        share = np.average([shares[name] for name in refuted], weights=[totals[name] for name in refuted])
        print(f"infeasible, by the number of labels of each bound: {share:.2%}")
    return 0
