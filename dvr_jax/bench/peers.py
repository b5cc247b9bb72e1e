"""The same keyframe and path problems solved by `robotic` (rai's KOMO) and by us: verdicts and CPU times side by side.

Each scene gives, for every length, sequences drawn at random and sequences whose keyframes our search finds feasible.
The latter favor ours, so the tables end with both kinds apart. Both solvers run warm, in one process on one core.
Loading, set-up and compilation are not timed.

- Keyframes: `robotic` solves its NLP once from the home posture, as its tutorials do. Ours is the sequence bound of
  every prefix: a beam of keyframe candidates, and NLPs from the best of them. It has neither the company of other
  sequences that a search has, nor the second look at a sequence that it refutes.
- Paths: one NLP each, from the solver's own keyframes.

The solutions of `robotic` are judged a second time, as points of our NLP by our measure; feasible paths are also judged
by the independent check.

`robotic` looks at slices alone, while our paths have three samples a slice and are looked at between them, too. So
paths are compared several times: both with constraints at the same slices alone; our paths as they are, with
`robotic`'s of as many slices; and with `robotic`'s of three times as many. `robotic` minimizes squared accelerations.
Ours stop at the first feasible point in these comparisons; the last two compare our optimal paths, with the time to the
first feasible point included, and the costs of the same objective.

`robotic` keeps no clearances and knows no straight approaches. By default ours keeps none either, so that both solve
the same problems.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.peer_judging import compare
from dvr_jax.bench.peer_tables import FINER, print_tables
from dvr_jax.bench.problem_drawing import find_sequences, random_extension
from dvr_jax.bench.rai_scene import CLEARANCE, ROUNDING, build_peer_scene, load_robotic
from dvr_jax.bench.results_file import ResultsFile, Row
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, Grounding
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.types import Scene
from dvr_jax.search.tree import SequenceTree
from dvr_jax.seeds.initial_paths import STEPS_PER_PHASE

LENGTHS = range(2, 7)
"""Lengths of the sequences."""


@dataclass(frozen=True)
class PeersOptions:
    """Solve the same problems with `robotic` and with ours, on one core."""

    number: int = 20
    """Scenes of two boxes."""
    drawn: int = 1
    """Sequences of each scene and length drawn at random; most are infeasible."""
    found: int = 1
    """Sequences of each scene and length whose keyframes our search finds feasible, where there are any."""
    seed: int = 1
    """Of scenes, sequences and both solvers."""
    clearance: float = 0.0
    """Factor of the clearances of our problems; `robotic` has none."""
    out: Path | None = None
    """JSON Lines file of results; scenes that it already has are not solved again."""


def draw_sequence(
    grounding: Grounding,
    scene: Scene,
    length: int,
    generator: np.random.Generator,
) -> tuple[Action, ...] | None:
    """Draw a sequence that first reaches the goal with its last action and that no constant of the scene refutes.

    Args:
        grounding: the scene's actions.
        scene: the scene.
        length: number of actions.
        generator: of the draw.

    Returns:
        The sequence; None where the draw comes to a dead end.
    """
    actions: list[Action] = []
    state = grounding.initial_state
    for left in range(length - 1, -1, -1):
        extension = random_extension(
            grounding, scene, state, partial(_reaches, grounding, left), generator
        )
        if extension is None:
            return None
        action, state = extension
        actions.append(action)
    return tuple(actions)


def _reaches(grounding: Grounding, left: int, state: int) -> bool:
    return grounding.reaches_goal_in(state, left)


def solve_scene(options: PeersOptions, index: int) -> list[Row]:
    """Solve all problems of one scene.

    Args:
        options: number of sequences and the seed.
        index: number of the scene.

    Returns:
        One row a problem.
    """
    scene = scene_of_seed(options.seed, index, 2).with_clearance(options.clearance)
    generator = np.random.default_rng([options.seed, index])
    tree = SequenceTree(scene, max(LENGTHS), options.seed)
    peer = build_peer_scene(scene)

    rows = []
    for length in LENGTHS:
        drawn = [
            draw_sequence(tree.grounding, scene, length, generator) for _ in range(options.drawn)
        ]
        found = [node.actions for node in find_sequences(tree, length, options.found, generator)]

        # A sequence that is both drawn and found counts as drawn, and is solved once.
        sources = {
            **dict.fromkeys(found, "found"),
            **dict.fromkeys(filter(None, drawn), "drawn"),
        }
        for actions, source in sources.items():
            arguments = [[action.operator, *action.arguments] for action in actions]
            solved = compare(peer, actions, options.seed)
            rows.append({"length": length, "source": source, "actions": arguments, **solved})
    return rows


def use_one_core() -> None:
    """Keep this process, and the libraries that it will load, to one core."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def _header(options: PeersOptions) -> Row:
    """Name what results must agree in to stand in one file."""
    chosen = asdict(options)
    for name in ("number", "out"):
        del chosen[name]
    return {
        **chosen,
        "steps": STEPS_PER_PHASE,
        "finer": FINER,
        "rounding": ROUNDING,
        "table_gap": CLEARANCE,
        "robotic": version("robotic"),
    }


def _results(options: PeersOptions) -> Iterator[Row]:
    results_file = ResultsFile(options.out, _header(options))
    todo = results_file.missing(options.number)
    for index in range(options.number):
        if index in todo:
            begin = time.monotonic()
            problems = solve_scene(options, index)
            results_file.add({"scene": index, "problems": problems})
            seconds = time.monotonic() - begin
            print(
                f"  scene {index}: {len(problems)} problems, {seconds:.0f} s",
                file=sys.stderr,
                flush=True,
            )
        yield from results_file.rows[index]["problems"]


def run(arguments: list[str]) -> int:
    """Solve all problems with both and print the tables."""
    options = tyro.cli(PeersOptions, prog="python -m dvr_jax.bench peers", args=arguments)
    if options.number < 1:
        raise DvrError(f"the number of scenes is {options.number}; valid is 1 or more.")

    # The number of threads has to be set before `robotic` is loaded.
    use_one_core()
    load_robotic()

    with jax.enable_x64(True):
        rows = list(_results(options))
    print_tables(rows)
    return 0
