"""Command line `python -m dvr_jax.sample`: draw random scenes into a JSON Lines file."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.errors import run_command
from dvr_jax.scene.files import save_scenes
from dvr_jax.scene.sampling import DEFAULT_DISTRIBUTION, SceneDistribution, ShapeChoice, sample_scenes


@dataclass(frozen=True)
class SampleOptions:
    """Draw random scenes: sizes, positions, turns and the target uniform within ranges, the target occupied in half."""

    number: int
    """Scenes to draw."""
    out: Path
    """JSON Lines file to write, one scene a line; replaced when it exists."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    seed: int = 0
    """Scene i of a seed is the same whatever --number is. Seeds 1 and 2 are the benchmarks',
    100 to 102 the shipped networks'."""
    shape: ShapeChoice = "box"
    """Shapes of the objects; mixed tosses a coin for each."""
    cubes: float = DEFAULT_DISTRIBUTION.cube_share
    """Share of the boxes that are small cubes, which one arm cannot hand to the other in the air."""


def main() -> int:
    """Read the options, draw, write, say what was written."""
    options = tyro.cli(SampleOptions, prog="python -m dvr_jax.sample")
    distribution = SceneDistribution(shape=options.shape, cube_share=options.cubes)
    scenes = tuple(sample_scenes(options.number, options.objects, options.seed, distribution))
    save_scenes(options.out, scenes)
    print(f"{len(scenes)} scenes of {options.objects} objects (seed {options.seed}) written to {options.out}")
    return 0


if __name__ == "__main__":
    run_command(main)
