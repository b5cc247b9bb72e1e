"""Command line `python -m dvr_jax.train --data FILES --out DIR`: train the network, or the feasibility classifier.

DIR then holds `network.npz` (which the searches load), `manifest.json` (what it was made from), `checkpoints/`,
`history.jsonl`, `events/` (TensorBoard), `curves.png` and `images.npz` (the rendered scenes, so that they are rendered
once). A run that was killed goes on when the same command is given again, to the same result to the last bit on the
same machine (on a GPU only with XLA_FLAGS=--xla_gpu_deterministic_ops=true).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from dvr_jax.cli.options import parse_options
from dvr_jax.errors import run_command

if TYPE_CHECKING:
    from dvr_jax.logic import Action
    from dvr_jax.scene.types import Scene


def main(arguments: Sequence[str] | None = None) -> int:
    """Load the data, train, and print how it goes.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    from dvr_jax.model.training_options import TrainOptions

    options = parse_options(TrainOptions, "train", arguments)
    options.check()

    from dvr_jax.dataset import examples
    from dvr_jax.dataset.shards import find_shards
    from dvr_jax.model.network_config import NetworkConfig
    from dvr_jax.model.training_data import prepare_training_data
    from dvr_jax.model.training_record import write_training_record
    from dvr_jax.model.training_run import train
    from dvr_jax.runtime.files import require_folder
    from dvr_jax.runtime.progress import Progress

    network = NetworkConfig(
        image_size=options.image_size,
        rays=options.rays,
        normals=options.normals,
        pooling=options.pooling,
        goal=options.kind == "dvr",
    )

    # A folder that cannot be written to is refused now, and not when the scenes have been rendered.
    require_folder(options.out)

    # Held-out data are loaded as the training data are; without any, a fraction of the scenes is held out.
    load = partial(examples.load_examples, completions=options.completions, k_max=options.k_max)
    with Progress("reading and rendering the scenes"):
        held_out = load(options.validation) if options.validation else None
        data = prepare_training_data(options, load(options.data), held_out, say, are_feasible)
    say(
        f"{len(data.sampler.sequences)} sequences to train on, {len(data.sampler.feasible)} of them feasible; "
        f"a target of 1 weighs {data.positive_weight:.2f}"
    )

    with Progress("training", options.steps, "steps") as progress:
        train(options, data, network, say, progress.reach)

    given = sys.argv[1:] if arguments is None else list(arguments)
    write_training_record(options.out, data, given, find_shards(options.data))
    say(f"written to {options.out}/")
    return 0


def say(line: str) -> None:
    """Print a line at once, also into a pipe."""
    print(line, flush=True)


def are_feasible(sequences: Sequence[tuple[Scene, tuple[Action, ...]]]) -> list[bool]:
    """Return the planner's verdict on one sequence of each scene."""
    import jax

    from dvr_jax.planning.feasibility import judge
    from dvr_jax.search.work import run_together

    with jax.enable_x64(True):
        verdicts = dict(run_together([judge(scene, [actions]) for scene, actions in sequences]))

    return [verdicts[index][0].feasible for index in range(len(sequences))]


if __name__ == "__main__":
    run_command(main)
