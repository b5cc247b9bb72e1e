"""Warm times of the solver's parts, on the problems of the recall benchmark: medians, in one process."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from dvr_jax.bench.metrics import save_metrics
from dvr_jax.bench.oracle import random_keyframes
from dvr_jax.bench.problems import read_problems
from dvr_jax.bench.recall import judge_prefix
from dvr_jax.bench.speed_metrics import KeyframeTimes, PathTimes, SliceTimes
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import number_of_phases
from dvr_jax.nlp.slices import reduce_slices
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, operator_of
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import Program, to_device
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.beam_batches import BeamTask, extend_beams
from dvr_jax.seeds.initial_paths import initial_path, keyframe_start, path_problem
from dvr_jax.seeds.keyframe_beam import CERTIFIED_PENETRATION
from dvr_jax.solver.iteration import evaluate_trials, initial_states, lay_out_chunks, measure_chunk
from dvr_jax.solver.lane_pool import solve, stack
from dvr_jax.solver.state import Settings
from dvr_jax.workcell.model import workcell_model
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL

NUMBERS_OF_OBJECTS = (2, 5)
"""Numbers of objects of the slices."""

LENGTHS = (2, 6)
"""Numbers of actions of the keyframe and path NLPs."""

KEYFRAME_REPEATS = 6
"""Times that a batch of keyframes is judged; the first one is not counted."""

NARROW = 0.04
"""Half of the widest object that a gripper closes on [m]."""


@dataclass(frozen=True)
class SpeedOptions:
    """Time the Gauss-Newton system of a slice, keyframe NLPs and path NLPs."""

    problems: Path | None = None
    """What `python -m dvr_jax.bench oracle` wrote; by default the problems of the package."""
    repeats: int = 200
    """Calls of each compiled program."""
    out: Path | None = None
    """JSON file to write the times to."""


def median_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Take the median time of a call whose result is waited for, after one call that is not counted.

    Args:
        call: gives JAX arrays.
        repeats: number of calls.

    Returns:
        The median [s].
    """
    jax.block_until_ready(call())

    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def time_slices(number_of_objects: int, repeats: int) -> SliceTimes:
    """Time distances, derivatives and Gauss-Newton matrix of a chunk of keyframe slices at random postures.

    Args:
        number_of_objects: objects of the scene.
        repeats: calls of each program.

    Returns:
        Times of a slice.
    """
    generator = np.random.default_rng(0)
    (scene,) = sample_scenes(1, number_of_objects, 1)
    name = scene.paper_goal.object
    arm = scene.workcell.arm_names[0]
    face = "+x" if scene.objects[scene.goal_index].half_extents[0] <= NARROW else "+y"
    actions = [
        Action("grasp", (arm, face, name)),
        Action("place", (arm, name, "goal")),
    ]
    problem = transcribe(scene, actions)
    model = to_device(workcell_model(scene.workcell))

    # As many lanes of two slices each as fill one chunk, the unit that the solver measures at once.
    chunk_size = batch_sizes().chunk
    number_of_lanes = chunk_size // len(actions)
    batch = stack([problem] * number_of_lanes)
    settings = jax.tree.map(np.asarray, Settings())
    postures = stack([random_keyframes(model, problem, generator) for _ in range(number_of_lanes)])
    states = initial_states(model, batch, postures, settings)
    (chunk,) = lay_out_chunks(batch, states.x)

    # The derivatives are taken with the multipliers that the solver has at this point.
    geometry = measure_chunk(model, chunk)
    _, (active,) = Program(evaluate_trials)(model, batch, settings, states, (geometry,))
    reduce_chunk = Program(reduce_slices)

    values = median_seconds(lambda: measure_chunk(model, chunk), repeats)
    derivatives = median_seconds(lambda: reduce_chunk(model, geometry, *active), repeats)
    return SliceTimes(
        objects=number_of_objects,
        rows=geometry.distance.shape[1],
        values=values / chunk_size,
        derivatives=derivatives / chunk_size,
    )


def time_keyframes(nodes: Sequence[Node], length: int) -> KeyframeTimes:
    """Time the verdicts on one batch of prefixes as a search takes them.

    All prefixes get a beam of keyframe candidates. Those that no candidate proves feasible get an NLP, from their best
    candidate.

    Args:
        nodes: nodes of prefixes.
        length: number of actions of those that are timed.

    Returns:
        Times of a prefix.
    """
    batch = [node for node in nodes if node.depth == length]
    tasks = [_beam_task(node) for node in batch]
    model = workcell_model(DEFAULT_WORKCELL)
    settings = Settings()

    beam_seconds = []
    nlp_seconds = []
    for _ in range(KEYFRAME_REPEATS):
        begin = time.perf_counter()
        extended = extend_beams(model, tasks, 0)
        middle = time.perf_counter()

        left = [
            (task.problem, keyframe_start(beam, 0, length))
            for task, beam in zip(tasks, extended, strict=True)
            if beam.violation.min() > CERTIFIED_PENETRATION
        ]
        results = solve(model, [problem for problem, _ in left], [x for _, x in left], settings)
        end = time.perf_counter()

        beam_seconds.append((middle - begin) / len(batch))
        nlp_seconds.append((end - middle) / len(batch))

    return KeyframeTimes(
        length=length,
        problems=len(batch),
        beam=statistics.median(beam_seconds[1:]),
        nlp=statistics.median(nlp_seconds[1:]),
        proved=len(batch) - len(left),
        found=sum(result.feasible for result in results),
    )


def _beam_task(node: Node) -> BeamTask:
    """What the beam of a node is sampled from."""
    assert node.problem is not None and node.parent is not None and node.parent.beam is not None
    last = number_of_phases(node.problem) - 1
    before = ModeKind(int(node.problem.mode_kind[last, node.problem.switched_object[last]]))
    proposal = operator_of(node.actions[-1], OPERATORS).proposal(before)
    return BeamTask(node.parent.beam, node.problem, proposal)


def time_paths(nodes: Sequence[Node], length: int) -> PathTimes:
    """Time path NLPs one by one, from feasible keyframes.

    Args:
        nodes: nodes of sequences with feasible keyframes.
        length: number of actions of those that are timed.

    Returns:
        Median time of a path.
    """
    model = workcell_model(DEFAULT_WORKCELL)
    settings = Settings()
    seconds = []
    iterations = []
    feasible = 0
    for node in nodes:
        if node.depth != length or node.problem is None or node.beam is None:
            continue
        x = initial_path(model, node.problem, keyframe_start(node.beam, 0, length))
        problem = path_problem(node.problem, x)

        # The first time may compile.
        solve(model, [problem], [x], settings)

        begin = time.perf_counter()
        (result,) = solve(model, [problem], [x], settings)
        seconds.append(time.perf_counter() - begin)
        iterations.append(result.iterations)
        feasible += result.feasible

    return PathTimes(
        length=length,
        problems=len(seconds),
        median=statistics.median(seconds),
        iterations=statistics.median(iterations),
        feasible=feasible,
    )


def run(arguments: list[str]) -> int:
    """Print all times."""
    options = tyro.cli(SpeedOptions, prog="python -m dvr_jax.bench speed", args=arguments)
    times: list[SliceTimes | KeyframeTimes | PathTimes] = []

    def keep(measured: SliceTimes | KeyframeTimes | PathTimes) -> None:
        times.append(measured)
        print(measured.line(), flush=True)

    with jax.enable_x64(True):
        for number_of_objects in NUMBERS_OF_OBJECTS:
            keep(time_slices(number_of_objects, options.repeats))

        drawn, sequences = _judge_problems(options.problems)
        for length in LENGTHS:
            keep(time_keyframes(drawn, length))
        for length in LENGTHS:
            keep(time_paths(sequences, length))

    if options.out is not None:
        save_metrics(
            options.out,
            "speed",
            [metric for measured in times for metric in measured.metrics()],
        )
    return 0


def _judge_problems(problems: Path | None) -> tuple[list[Node], list[Node]]:
    """Nodes of keyframe problems with a feasible parent, and nodes with feasible keyframes for the paths."""
    drawn: list[Node] = []
    feasible: list[Node] = []
    for scene, actions, row in read_problems(problems):
        if row["length"] not in LENGTHS:
            continue
        node = run_alone(judge_prefix(SequenceTree(scene, k_max=6), actions))
        if node.parent is None or not node.parent.feasible:
            continue

        # Path problems were chosen for feasible keyframes, the cheaper ones.
        if row["kind"] == "keyframes":
            drawn.append(node)
        if node.feasible:
            feasible.append(node)
    return drawn, feasible
