"""Warm times of the solver's parts, on the problems of the recall benchmark: medians, on one process."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from dvr_jax.bench.recall import PROBLEMS, judge_prefix, random_keyframes, read_problems
from dvr_jax.logic import Action
from dvr_jax.nlp.slices import reduce_slices
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import CERTIFIED_PENETRATION
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.initial_paths import keyframe_start, path_problem, path_start
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.engine import beam_lanes, extend_beams, solve, stack
from dvr_jax.solver.iteration import judge, lay_out_chunks, measure_chunk, start


@dataclass(frozen=True)
class SpeedOptions:
    """Time the Gauss-Newton system of a slice, keyframe NLPs and path NLPs."""

    problems: Path = PROBLEMS
    """What `python -m dvr_jax.bench oracle` wrote."""
    repeats: int = 200
    """Calls of each compiled program."""


def median_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median time of a call whose result is waited for, after one that is not counted."""
    jax.block_until_ready(call())
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def time_slices(number_of_objects: int, repeats: int) -> None:
    """Distances, derivatives and Gauss-Newton matrix of a chunk of keyframe slices at random postures."""
    generator = np.random.default_rng(0)
    (scene,) = sample_scenes(1, number_of_objects, 1)
    name = scene.goal.object
    face = "+x" if scene.objects[scene.goal_index].half_extents[0] <= 0.04 else "+y"
    actions = [Action("grasp", ("left", face, name)), Action("place", ("left", name, "goal"))]
    problem = transcribe(scene, actions)
    chunk_size = batch_sizes().chunk
    batch = stack([problem] * (chunk_size // 2))
    settings = jax.tree.map(np.asarray, Settings())
    lanes = start(batch, stack([random_keyframes(problem, generator) for _ in range(chunk_size // 2)]), settings)
    (chunk,) = lay_out_chunks(batch, lanes.x)
    measured = measure_chunk(chunk)
    _, (push,) = Program(judge)(batch, settings, lanes, (measured,))
    reduce_chunk = Program(reduce_slices)
    rows = measured.distance.shape[1]
    parts = [
        median_seconds(lambda: measure_chunk(chunk), repeats),
        median_seconds(lambda: reduce_chunk(measured, *push), repeats),
    ]
    microseconds = [1e6 * part / chunk_size for part in parts]
    print(
        f"Gauss-Newton system, {number_of_objects} objects ({rows} rows): "
        f"{sum(microseconds):.1f} us a slice ({microseconds[0]:.1f} values, {microseconds[1]:.1f} derivatives)"
    )


def time_keyframes(nodes: list[Node], length: int) -> None:
    """Verdicts on one batch of prefixes as a search takes them: particles of all, then the NLP of those that no
    particle proves feasible, from its best particle."""
    batch = [node for node in nodes if node.depth == length]
    problems = [node.problem for node in batch if node.problem is not None]
    parents = [node.parent.beam for node in batch if node.parent is not None and node.parent.beam is not None]
    settings = Settings()
    sampling, solving = [], []
    for _ in range(6):
        begin = time.perf_counter()
        extended = extend_beams(parents, problems, 0, beam_lanes(problems))
        middle = time.perf_counter()
        left = [
            (problem, keyframe_start(particles, 0, length))
            for problem, particles in zip(problems, extended, strict=True)
            if particles.violation.min() > CERTIFIED_PENETRATION
        ]
        results = solve([problem for problem, _ in left], [x for _, x in left], settings)
        sampling.append((middle - begin) / len(batch))
        solving.append((time.perf_counter() - middle) / len(batch))
    proved, found = len(batch) - len(left), sum(result.feasible for result in results)
    per_sampling, per_solving = (1e3 * statistics.median(seconds[1:]) for seconds in (sampling, solving))
    print(
        f"keyframes of length {length}, {per_sampling + per_solving:.1f} ms a problem in a batch of {len(batch)}: "
        f"{per_sampling:.1f} ms for particles, which prove {proved} feasible, {per_solving:.1f} ms for the NLPs of the "
        f"others, {found} feasible"
    )


def time_paths(nodes: list[Node], length: int) -> None:
    """Path NLPs one by one, from feasible keyframes."""
    seconds, iterations, feasible = [], [], 0
    for node in nodes:
        if node.depth != length or node.problem is None or node.beam is None:
            continue
        x = path_start(node.problem, keyframe_start(node.beam, 0, length))
        task = [path_problem(node.problem, x)], [x], Settings()
        solve(*task)
        begin = time.perf_counter()
        (result,) = solve(*task)
        seconds.append(time.perf_counter() - begin)
        iterations.append(result.iterations)
        feasible += result.feasible
    print(
        f"path NLPs of length {length}: median {1e3 * statistics.median(seconds):.0f} ms, "
        f"{statistics.median(iterations):.0f} iterations, {feasible} of {len(seconds)} feasible"
    )


def run(arguments: list[str]) -> int:
    """Print all times."""
    options = tyro.cli(SpeedOptions, prog="python -m dvr_jax.bench speed", args=arguments)
    nodes: list[Node] = []
    drawn: list[Node] = []
    with jax.enable_x64(True):
        for number_of_objects in (2, 5):
            time_slices(number_of_objects, options.repeats)
        for scene, actions, row in read_problems(options.problems):
            if row["length"] in (2, 6):
                node = run_alone(judge_prefix(SequenceTree(scene, k_max=6), actions))
                if node.parent is not None and node.parent.feasible:
                    nodes.append(node)
                    drawn.extend([node] if row["kind"] == "keyframes" else [])
        for length in (2, 6):
            time_keyframes(drawn, length)  # path problems were chosen for feasible keyframes, the cheaper ones
        for length in (2, 6):
            time_paths([node for node in nodes if node.feasible], length)
    return 0
