"""The whole pipeline on a toy scale: draw scenes, label sequences, train a network, and plan with it.

The commands are those of a real data set; only the numbers are small. A real sweep labels thousands of scenes, and a
real training takes tens of thousands of steps.
"""

import subprocess
import sys
from pathlib import Path

import dvr_jax as dvr

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/sweep_and_train")
folder.mkdir(parents=True, exist_ok=True)


def run(command: str, *options: object) -> None:
    """Run one of the package's commands; it is the same as `dvr-jax COMMAND OPTIONS` in a shell."""
    arguments = [str(option) for option in options]
    print("\n$ dvr-jax", command, *arguments, flush=True)
    subprocess.run([sys.executable, "-m", f"dvr_jax.{command}", *arguments], check=True)


# 1. Random scenes. Seeds 1, 2 and 100 to 102 are taken by the benchmarks and the shipped networks.
scenes = folder / "scenes.jsonl"
run("sample", "--number", 4, "--objects", 2, "--seed", 5, "--out", scenes)

# 2. Labels: one feasible sequence for each scene is enough here, and sequences have at most three actions.
labels = folder / "labels"
small = ("--solutions", 1, "--leaves", 50, "--k-max", 3, "--shard", 2, "--workers", 1)
run("sweep", "--scenes", scenes, "--out", labels, *small)

# 3. What is in them, beside the paper's data.
run("dataset", labels)

# 4. A tiny network with small images and few steps.
trained = folder / "trained"
tiny = ("--image-size", 32, "--rays", 1, "--steps", 20, "--held-out", 0.25)
often = ("--log-every", 10, "--checkpoint-every", 20, "--validate-every", 20)
run("train", "--data", labels, "--out", trained, *tiny, *often)

# 5. Plan with it. Where the network errs, and this one does, the search continues.
network = dvr.Predictor.load(trained / "network.npz")
for number, scene in enumerate(dvr.load_scenes(scenes)):
    result = dvr.plan(scene, network=network, k_max=3, time_limit=600)
    print(f"\nscene {number}: {result.status}", *result.action_descriptions, sep="\n  ")
