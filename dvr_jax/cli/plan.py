"""Command line `python -m dvr_jax.plan SCENE.json`: from a scene file to a checked two-arm motion."""

from __future__ import annotations

import json
import platform
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dvr_jax.errors import DvrError, run_command
from dvr_jax.motion import save_motion
from dvr_jax.planning.planner import Plan, plan
from dvr_jax.runtime.files import require_folder
from dvr_jax.scene.files import load_scene, scene_to_json
from dvr_jax.scene.mjcf import scene_xml
from dvr_jax.search.searches import GUIDED

EXIT_SOLVED, EXIT_NONE_FOUND = 0, 1

_REPLACED = ("plan.json", "trajectory.npz", "film.png", "plan.gif")
"""Files of another plan, of which none may stay: the first one comes last, with what it describes, the others only if a
plan was found."""


@dataclass(frozen=True)
class PlanOptions:
    """Find a sequence of grasps, handovers and places that solves a scene, and a motion of two arms that carries it
    out.

    Exit code 0: solved, and the motion passed the independent check; 1: none found; 2: bad input.
    """

    scene: Annotated[Path, tyro.conf.Positional]
    """Scene file (JSON)."""
    search: Literal["dvr", "classifier", "mbts", "bfs"] = "dvr"
    """Guided by a network as in the paper or by a feasibility classifier; multi-bound tree search; breadth-first."""
    network: Path | None = None
    """Trained network of the search's kind, for dvr and classifier: a file network.npz, or a training's folder; by
    default the shipped one."""
    k_max: int = 6
    """Largest number of actions."""
    seed: int = 0
    """Of all sampling; the same seed gives the same plan."""
    time_limit: float = 300.0
    """Seconds after which the search gives up. The first plan ever compiles for most of a minute, which counts."""
    out: Path | None = None
    """Folder for plan.json, trajectory.npz, scene.xml, film.png, depth.png and plan.gif; made if missing."""
    animation: bool = True
    """Also write plan.gif (some seconds)."""


def write_plan(folder: Path, result: Plan, animation: bool) -> None:
    """Write everything that is known of a plan into a folder."""
    # Half a second that others need not wait.
    from dvr_jax.drawing.animation import save_animation
    from dvr_jax.drawing.depth_picture import save_depth_picture
    from dvr_jax.drawing.film import save_film

    folder.mkdir(parents=True, exist_ok=True)
    for name in _REPLACED:
        (folder / name).unlink(missing_ok=True)
    (folder / "scene.xml").write_text(scene_xml(result.scene), encoding="utf-8")
    save_depth_picture(folder / "depth.png", result.scene)
    if result.motion is not None:
        save_motion(folder / "trajectory.npz", result.motion)
        save_film(folder / "film.png", result.scene, result.words, result.motion)
        if animation:
            save_animation(folder / "plan.gif", result.scene, result.motion)
    (folder / "plan.json").write_text(json.dumps(describe_plan(result), indent=1) + "\n", encoding="utf-8")


def describe_plan(result: Plan) -> dict[str, object]:
    """What plan.json holds."""
    report = result.report
    return {
        "status": result.status,
        "actions": [{"operator": action.operator, "arguments": list(action.arguments)} for action in result.actions],
        "words": list(result.words),
        "nlps": result.nlps,
        "verdicts": result.verdicts,
        "rejected_by_check": result.rejected,
        "seconds": {stage: round(value, 4) for stage, value in result.seconds.items()},
        "violations": result.violations,
        "check": None
        if report is None
        else {"passed": report.passed, "deepest_penetration": report.deepest_penetration},
        "options": result.options,
        "scene": json.loads(scene_to_json(result.scene)),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("dvr_jax", "jax", "mujoco", "numpy")},
        },
    }


def main() -> int:
    """Plan, say what was found, write it."""
    options = tyro.cli(PlanOptions, prog="python -m dvr_jax.plan")
    scene = load_scene(options.scene)
    network = None
    if options.search in GUIDED:
        from dvr_jax.model.predictor import load_network

        network = load_network(options.search, options.network)
    elif options.network is not None:
        raise DvrError(f"--search {options.search} takes no --network; valid with one: {', '.join(GUIDED)}.")
    if options.out is not None:
        require_folder(options.out)  # rather now than when a plan has been found
    result = plan(
        scene, options.search, options.k_max, options.seed, options.time_limit,
        progress=lambda line: print(f"  {line}", file=sys.stderr, flush=True),
        network=network,
    )  # fmt: skip
    if result.solved:
        assert result.motion is not None
        print(f"solved with {len(result.actions)} actions, a motion of {result.motion.time[-1]:.1f} s:")
        for number, words in enumerate(result.words, start=1):
            print(f"  {number}. {words}")
    else:
        print(f"none found: {result.status} (at most {options.k_max} actions, {options.time_limit:g} s)")
    print("NLPs solved: " + (", ".join(f"{count} {bound}" for bound, count in result.nlps.items()) or "none"))
    print("seconds: " + ", ".join(f"{stage} {value:.2f}" for stage, value in result.seconds.items()))
    if options.out is not None:
        write_plan(options.out, result, options.animation)
        print(f"written to {options.out}/")
    return EXIT_SOLVED if result.solved else EXIT_NONE_FOUND


if __name__ == "__main__":
    # What the warm-up still compiles, nobody waits for.
    run_command(main, at_once=True)
