"""Labels of a sweep against an oracle of 64 random starts: are infeasible rows infeasible, and feasible ones feasible?

An infeasible row is confirmed if no start finds feasible keyframes or, where keyframes exist, no start finds a path; a
feasible one if some start finds both."""

from __future__ import annotations

import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.recall import oracle_keyframes, oracle_path
from dvr_jax.dataset.examples import find_shards
from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.shards import read_shard
from dvr_jax.komo.transcription import transcribe
from dvr_jax.logic import Action
from dvr_jax.scene.types import Scene


@dataclass(frozen=True)
class LabelsOptions:
    """Judge random labels again, with an oracle of 64 random starts."""

    data: Path
    """Folder of shards."""
    number: int = 300
    """Labels of each verdict; those that a constant of the scene refutes are left out."""
    seed: int = 0
    """Of the draw and of the starts."""


def oracle_verdict(scene: Scene, label: Label, generator: np.random.Generator) -> bool:
    """Whether some of 64 random starts is feasible, under the bounds that the label speaks of."""
    actions = [Action.parse(text) for text in label.actions]
    needs_path = label.feasible or label.bound in ("path", "check")
    found = oracle_keyframes(scene, actions, generator, enough=8 if needs_path else 1)
    return bool(found) and (not needs_path or oracle_path(transcribe(scene, actions), found, generator))


def run(arguments: list[str]) -> int:
    """Print the confirmed share by verdict and bound."""
    options = tyro.cli(LabelsOptions, prog="python -m dvr_jax.bench labels", args=arguments)
    rows: dict[bool, list[tuple[Scene, Label]]] = {True: [], False: []}
    for info in find_shards(options.data):
        shard = read_shard(info.path)
        for label in shard.labels:
            if label.bound != "symbolic":
                rows[label.feasible].append((shard.scenes[label.scene - shard.info.scenes.start], label))
    generator = np.random.default_rng(options.seed)
    counts: dict[str, list[bool]] = defaultdict(list)
    with jax.enable_x64(True):
        for feasible, found in rows.items():
            for index in generator.permutation(len(found))[: options.number]:
                scene, label = found[index]
                confirmed = oracle_verdict(scene, label, generator) == feasible
                counts["feasible" if feasible else f"infeasible by {label.bound}"].append(confirmed)
                if not confirmed:
                    print(f"  not confirmed: {label}, {label.bound or 'feasible'}", file=sys.stderr, flush=True)
    for name, verdicts in sorted(counts.items()):
        print(f"{name:<24} {sum(verdicts):>5} of {len(verdicts):>5} confirmed ({np.mean(verdicts):.1%})")
    infeasible = [verdict for name, verdicts in counts.items() if name != "feasible" for verdict in verdicts]
    if infeasible:
        print(f"{'infeasible, all':<24} {sum(infeasible):>5} of {len(infeasible):>5} confirmed")
    return 0
