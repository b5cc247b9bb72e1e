"""Command line `python -m dvr_jax.train --data FILES --out DIR`: train the network, or the feasibility classifier.

DIR then holds `network.npz` (what the searches load), `manifest.json` (what it comes of), `checkpoints/`,
`history.jsonl`, `events/` (TensorBoard), `curves.png` and `images.npz` (the rendered scenes, so that they are rendered
once). A run that was killed goes on when the same command is given again, to the same result to the last bit on the
same machine (on a GPU only with XLA_FLAGS=--xla_gpu_deterministic_ops=true).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

import jax
import tyro

from dvr_jax.dataset import load_examples
from dvr_jax.dataset.examples import find_shards
from dvr_jax.errors import run_command
from dvr_jax.logic import Action
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.training_data import prepare_training_data
from dvr_jax.model.training_options import TrainOptions
from dvr_jax.model.training_record import write_training_record
from dvr_jax.model.training_run import train
from dvr_jax.planning.feasibility import judge
from dvr_jax.scene.types import Scene
from dvr_jax.search.work import run_together


def say(line: str) -> None:
    """Print at once, also into a pipe."""
    print(line, flush=True)


def are_feasible(sequences: Sequence[tuple[Scene, tuple[Action, ...]]]) -> list[bool]:
    """The planner's verdicts on one sequence each of scenes."""
    with jax.enable_x64(True):
        verdicts = dict(run_together([judge(scene, [actions]) for scene, actions in sequences]))
    return [verdicts[index][0].feasible for index in range(len(sequences))]


def main() -> int:
    """Load, train, say how it goes."""
    options = tyro.cli(TrainOptions, prog="python -m dvr_jax.train")
    options.check()
    network = NetworkConfig(
        image_size=options.image_size,
        rays=options.rays,
        normals=options.normals,
        pooling=options.pooling,
        goal=options.kind == "dvr",
    )
    load = partial(load_examples, completions=options.completions, k_max=options.k_max)
    held_out = load(options.validation) if options.validation else None
    data = prepare_training_data(options, load(options.data), held_out, say, are_feasible)
    say(
        f"{len(data.sampler.sequences)} sequences to train on, {len(data.sampler.feasible)} of them feasible; "
        f"a target of 1 weighs {data.positive_weight:.2f}"
    )
    train(options, data, network, say)
    write_training_record(options.out, data, sys.argv[1:], find_shards(options.data))
    say(f"written to {options.out}/")
    return 0


if __name__ == "__main__":
    run_command(main)
