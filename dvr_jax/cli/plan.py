"""Command line `python -m dvr_jax.plan SCENE.json`: from a scene file to a checked two-arm motion.

`python -m dvr_jax.plan SCENES.jsonl --out DIR` plans all scenes of a file (`dvr_jax.cli.plan_many`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from dvr_jax.cli.options import parse_options
from dvr_jax.cli.plan_many import SUFFIX, plan_many
from dvr_jax.errors import OptionError, run_command

if TYPE_CHECKING:
    from dvr_jax.model.predictor import Predictor
    from dvr_jax.planning.planner import Plan

EXIT_SOLVED = 0
"""Exit code for a plan whose motion passed the check."""

EXIT_NONE_FOUND = 1
"""Exit code for a search that ended without a plan."""


@dataclass(frozen=True)
class PlanOptions:
    """Find a sequence of actions that solves a scene, and a motion of the arms that carries it out.

    A file of many scenes is planned by several processes into one folder for each scene, with a table of results. A run
    that was stopped goes on when the same command is given again.

    Exit code 0: solved, and the motion passed the independent check; 1: none found, or not for every scene; 2: bad
    input.
    """

    scene: Annotated[Path, tyro.conf.Positional]
    """Scene file (*.json), or a file of many scenes, one a line (*.jsonl, as `python -m dvr_jax.sample` writes it)."""
    search: Literal["dvr", "classifier", "mbts", "bfs"] = "dvr"
    """Guided by a network as in the paper (dvr), guided by a feasibility classifier (classifier), multi-bound tree
    search (mbts), or breadth-first search (bfs)."""
    network: Path | None = None
    """Trained network of the search's kind, for dvr and classifier: a file network.npz, or the folder of a training.
    By default the shipped network."""
    k_max: int | None = None
    """Largest number of actions; by default 6, and if these do not suffice, up to the lower bound on the number of
    actions plus 4."""
    shortest: bool = False
    """Find a plan of the least number of actions."""
    seed: int = 0
    """Seed of all sampling; the same seed gives the same plan."""
    time_limit: float = 300.0
    """Seconds after which the search gives up. A machine's first plan compiles for most of a minute, which counts."""
    clearance: float = 1.0
    """Factor of the distances that bodies keep, from 0 to 3."""
    termination: Literal["feasible", "optimal"] = "optimal"
    """Optimize the path until it satisfies the KKT conditions (optimal), or take the first feasible one (feasible)."""
    out: Path | None = None
    """Folder for plan.json, trajectory.npz, scene.xml, film.png, depth.png and plan.gif; it is made if missing."""
    animation: bool = True
    """Also write plan.gif, which takes some seconds."""
    workers: int | None = None
    """Number of processes for a file of many scenes, which plan one scene each at a time; by default one a core."""
    ray: str | None = None
    """Address of a Ray cluster whose CPUs take the workers' place ("auto": the one that runs on this machine)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan a scene, print what was found, and write it into a folder.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    options = parse_options(PlanOptions, "plan", arguments)
    if options.scene.suffix == SUFFIX:
        return plan_many(options)
    if options.workers is not None or options.ray is not None:
        raise OptionError(
            f"--workers and --ray are for a file of many scenes (*{SUFFIX}); {options.scene} is none."
        )

    # The programs of the last plan of this kind are loaded while the modules of the planner are imported.
    from dvr_jax.runtime.compilation import keep_programs_of, load_programs_of

    purpose = _purpose(options)
    load_programs_of(purpose)

    from dvr_jax.planning.planner import plan
    from dvr_jax.runtime.files import require_folder
    from dvr_jax.runtime.progress import Progress
    from dvr_jax.scene.files import load_scene

    scene = load_scene(options.scene)
    network = _load_network(options)
    if options.out is not None:
        # A folder that cannot be written to is refused now, and not when a plan has been found.
        require_folder(options.out)

    with Progress("planning", detail=_compilation_of(get_ident())):
        result = plan(
            scene,
            options.search,
            options.k_max,
            options.seed,
            options.time_limit,
            progress=_report_progress,
            network=network,
            clearance=options.clearance,
            termination=options.termination,
            shortest=options.shortest,
        )
    if not result.solved and result.reason is None:
        from dvr_jax.planning.causes import with_causes

        with Progress("looking for the causes"):
            result = with_causes(result)
    if options.out is not None:
        # Written before anything is printed, because the reader of the output may have gone.
        with Progress("drawing the pictures"):
            result.save(options.out, animation=options.animation)

    keep_programs_of(purpose)
    _print_plan(result, options)
    if options.out is not None:
        print(f"written to {options.out}/")

    return EXIT_SOLVED if result.solved else EXIT_NONE_FOUND


def _purpose(options: PlanOptions) -> str:
    """Name the programs that a plan is likely to need, by the number of objects and the kind of search."""
    try:
        objects = options.scene.read_bytes().count(b'"shape"')
    except OSError:
        # The file is refused a little later, with a reason.
        objects = 0
    return f"plan-{objects}-bodies-{options.search}-{options.k_max}-{options.termination}"


def _compilation_of(thread: int) -> Callable[[], str]:
    """Return a function that tells whether a thread waits for a program to be compiled."""
    from dvr_jax.runtime.compilation import awaited_program, compiling_programs

    def describe() -> str:
        """Return a part of a line about the progress."""
        if awaited_program(thread) is None or not compiling_programs():
            return ""
        return "compiling, which only the first plans on a machine do"

    return describe


def _load_network(options: PlanOptions) -> Predictor | None:
    """Return the network that an option names, or None for the shipped one."""
    if options.network is None:
        return None

    from dvr_jax.search.searches import GUIDED

    if options.search not in GUIDED:
        raise OptionError(
            f"--search {options.search} takes no --network; valid with one: {', '.join(GUIDED)}."
        )

    from dvr_jax.model.predictor import load_network

    return load_network(options.search, options.network)


def _print_plan(result: Plan, options: PlanOptions) -> None:
    """Print the actions of a plan, or why there are none, and what it took."""
    if result.solved and not result.actions:
        print("solved: no action is needed")
    elif result.motion is not None:
        print(
            f"solved with {len(result.actions)} actions, a motion of {result.motion.time[-1]:.1f} s:"
        )
        for number, description in enumerate(result.action_descriptions, start=1):
            print(f"  {number}. {description}")
    else:
        k_max = result.options["k_max"]
        print(f"none found: {result.status} (at most {k_max} actions, {options.time_limit:g} s)")
        if "longer_k_max" in result.options:
            print(
                f"sequences of up to {result.options['longer_k_max']} actions were searched for "
                f"{result.seconds['longer']:.1f} s without a result (--k-max searches all of them)"
            )
        _print_reasons(result)

    nlps = ", ".join(f"{count} {bound}" for bound, count in result.nlps.items())
    print(f"NLPs solved: {nlps or 'none'}")

    seconds = ", ".join(f"{stage} {value:.2f}" for stage, value in result.seconds.items())
    print(f"seconds: {seconds}")


def _print_reasons(result: Plan) -> None:
    """Print why the scene has no solution, or why the most promising sequences fail."""
    if result.reason is not None:
        print(f"reason: {result.reason}")
        return
    for refuted in result.refuted:
        print(f"  {' '.join(map(str, refuted.actions))}")
        print(f"    {refuted.reason}")


def _report_progress(line: str) -> None:
    """Print a line about what is going on."""
    print(f"  {line}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    run_command(main, at_once=True)
