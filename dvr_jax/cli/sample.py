"""Command line `python -m dvr_jax.sample`: draw random scenes into a JSON Lines file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dvr_jax.cli.options import LARGEST_NUMBER, parse_options, require_range
from dvr_jax.errors import run_command


@dataclass(frozen=True)
class SampleOptions:
    """Draw random scenes: sizes, positions, yaws and target uniform within ranges, the target occupied in half."""

    number: int
    """Number of scenes."""
    out: Path
    """JSON Lines file to write, one scene a line; it is replaced if it exists."""
    objects: int = 2
    """Number of objects in each scene, 1 to 8."""
    seed: int = 0
    """Seed; scene i of a seed is the same whatever --number is. The benchmarks use seeds 1 and 2, the shipped networks
    were trained on seeds 100 to 102."""
    shape: Literal["box", "cylinder", "mixed"] = "box"
    """Shapes of the objects; with mixed, a coin decides for each object."""
    cubes: float = 0.25
    """Fraction of the boxes that are small cubes, which one arm cannot hand to the other in the air."""
    workcell: str = "facing"
    """Arms and table: facing (the paper's), facing-1.0, facing-1.6, side-by-side or single."""
    goals: int = 1
    """Number of objects that shall stand on the target; with more than one, all hands shall be empty too."""
    raised: bool = False
    """Whether the target is the top of a bench of random height; all hands shall be empty then, too."""
    fixed: tuple[int, int] = (0, 0)
    """Least and largest number of fixed bodies in each scene."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw scenes and write them.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    options = parse_options(SampleOptions, "sample", arguments)
    require_range("number", options.number, 1, LARGEST_NUMBER)

    from dvr_jax.runtime.files import require_writable
    from dvr_jax.runtime.progress import Progress
    from dvr_jax.scene.files import save_scenes
    from dvr_jax.scene.random_scenes import sample_scenes
    from dvr_jax.scene.sampling import SceneDistribution
    from dvr_jax.workcell.workcell import named_workcell

    # A place that cannot be written to is refused now, and not when all scenes have been drawn.
    require_writable(options.out)
    workcell = named_workcell(options.workcell)
    distribution = SceneDistribution(
        shape=options.shape, cube_share=options.cubes, fixed_bodies=options.fixed
    )
    scenes = []
    with Progress("drawing", options.number, "scenes") as progress:
        for scene in sample_scenes(
            options.number,
            options.objects,
            options.seed,
            distribution,
            workcell,
            options.goals,
            options.raised,
        ):
            scenes.append(scene)
            progress.advance()
    save_scenes(options.out, scenes)

    print(
        f"{len(scenes)} scenes of {options.objects} objects (seed {options.seed}) written to {options.out}"
    )
    return 0


if __name__ == "__main__":
    run_command(main)
