"""Plan several scenes at a time, each by a process of its own, and save the plans as they are ready."""

from __future__ import annotations

from pathlib import Path

import dvr_jax as dvr

OUT = Path("out/many")


def main() -> None:
    """Plan four scenes on two cores."""
    scenes = list(dvr.sample_scenes(4, objects=2, seed=7))

    for result in dvr.plan_scenes(scenes, workers=2):
        if result.plan is None:
            print(f"scene {result.index}: {result.failure}")
            continue

        print(f"scene {result.index}: {result.plan}")
        result.plan.save(OUT / f"scene-{result.index}", animation=False)


# The workers import this file, and must not plan the scenes once more.
if __name__ == "__main__":
    main()
