"""One sequence solved by `robotic` and by us: verdicts and CPU times, and their solutions judged by our measure.

Both solvers run warm. Loading, set-up and compilation are not timed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import jax
import numpy as np

from dvr_jax.bench.peer_tables import FINER
from dvr_jax.bench.rai import (
    PeerSolution,
    build_keyframes,
    build_path,
    solve_peer,
    to_variables,
)
from dvr_jax.bench.rai_scene import PeerScene
from dvr_jax.bench.recall import judge_prefix
from dvr_jax.bench.results_file import Row
from dvr_jax.checker.kinds import PENETRATION
from dvr_jax.checker.replay import check_motion
from dvr_jax.logic import Action
from dvr_jax.nlp.cost import path_cost
from dvr_jax.nlp.evaluation import relative_violation
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.planning.path_motion import interpolate
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.initial_paths import (
    STEPS_PER_PHASE,
    initial_path,
    optimal_path_problem,
    path_problem,
)
from dvr_jax.solver.iteration import evaluate_trials, initial_states, lay_out_chunks, measure_chunk
from dvr_jax.solver.lane_pool import NlpSolution, solve, stack
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import Settings
from dvr_jax.workcell.model import WorkcellModel, workcell_model

DEEPEST_PENETRATION = 3e-3
"""Deepest penetration of a path that passes the check here [m]. Plans keep clearances, so that the check of plans
allows less; these paths keep none, and each solver lets bodies touch within its tolerance."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class Timed(Generic[_T]):
    """A call's result and what it took."""

    result: _T
    """What the call gave."""
    cpu_seconds: float
    """CPU time of the process [s]."""
    wall_seconds: float
    """Wall time [s]."""


def time_call(call: Callable[[], _T]) -> Timed[_T]:
    """Time a call."""
    cpu = time.process_time()
    wall = time.perf_counter()
    result = call()
    return Timed(
        result=result,
        cpu_seconds=time.process_time() - cpu,
        wall_seconds=time.perf_counter() - wall,
    )


_evaluate = Program(evaluate_trials)


def judge_point(model: WorkcellModel, problem: Problem, x: Variables) -> dict[str, float]:
    """Measure our violations at a point.

    Args:
        model: arms of the workcell.
        problem: keyframe problem of the sequence.
        x: keyframes, or a path with several slices a phase.

    Returns:
        Largest violation of each kind [m or rad]; "ratio", the largest one as a multiple of its tolerance; and "ratio
        at slices", the same without what is between the slices of a path.
    """
    T = len(x.q)
    K = len(x.m)
    if T > K:
        problem = path_problem(problem, x)

    # As many lanes as the solver has, so that its compiled program serves for the distances.
    lanes = batch_sizes().chunk // K if T == K else batch_sizes().path_lanes
    settings = jax.tree.map(np.asarray, Settings())
    batch: Problem = stack([problem] * lanes)
    states = initial_states(model, batch, stack([x] * lanes), settings)
    chunks = tuple(measure_chunk(model, chunk) for chunk in lay_out_chunks(batch, states.x))
    trials, _ = _evaluate(model, batch, settings, states, chunks)
    values = {name: float(value[0]) for name, value in trials.violations.items()}

    # The last sample of each interval is its slice; penetrations elsewhere are left out of the second ratio.
    M = problem.sample_fraction.shape[1]
    distances = np.concatenate([np.asarray(chunk.distance) for chunk in chunks])[: T * M]
    deepest_at_slices = max(0.0, -float(distances[M - 1 :: M].min()))
    at_slices = {**values, "penetration": deepest_at_slices}

    return {
        **values,
        "ratio": float(relative_violation(values)),
        "ratio at slices": float(relative_violation(at_slices)),
    }


def _passes(scene: Scene, actions: Sequence[Action], problem: Problem, q: Any, m: Any) -> bool:
    """Return whether the check finds nothing in the motion along a path but penetrations that are not deep."""
    motion = interpolate(scene, problem, np.asarray(q), np.asarray(m))
    findings = check_motion(scene, actions, motion).findings
    return all(
        finding.definition == PENETRATION and finding.value <= DEEPEST_PENETRATION
        for finding in findings
    )


def _our_keyframes(
    scene: Scene, actions: Sequence[Action], seed: int
) -> tuple[SequenceTree, Node, Row]:
    """The sequence bound: a beam for every prefix, and NLPs where no candidate is feasible."""
    # The first time compiles.
    for _ in range(2):
        tree = SequenceTree(scene, len(actions), seed)
        timed = time_call(partial(run_alone, judge_prefix(tree, actions)))

    node = timed.result
    row = {
        "feasible": bool(node.feasible),
        "seconds": timed.cpu_seconds,
        "wall seconds": timed.wall_seconds,
    }
    return tree, node, row


def _our_path(scene: Scene, node: Node, find: Callable[[], NlpSolution]) -> Row:
    # The first time compiles.
    find()

    timed = time_call(find)
    path = timed.result
    assert node.problem is not None
    return {
        "feasible": path.feasible,
        "seconds": timed.cpu_seconds,
        "wall seconds": timed.wall_seconds,
        "iterations": path.iterations,
        "ratio": path.relative_violation,
        "cost": path_cost(np.asarray(node.problem.home), path.q),
        "passed": path.feasible and _passes(scene, node.actions, node.problem, path.q, path.m),
    }


def _optimal_path(tree: SequenceTree, node: Node) -> NlpSolution:
    """Our path of least cost: the first feasible path, optimized further for the objective that both solvers have."""
    path = run_alone(tree.solver.solve_path(node))
    if not path.feasible:
        return path
    assert node.problem is not None
    start = Variables(path.q, path.m)
    problem = optimal_path_problem(node.problem, start)
    problem = problem._replace(preference_scale=np.zeros_like(problem.preference_scale))
    optimal = solve(tree.solver.model, [problem], [start], SequentialSettings())[0]
    return optimal if optimal.feasible else path


def _path_at_slices(tree: SequenceTree, node: Node) -> NlpSolution:
    """Our path with distances at its slices alone."""
    assert node.problem is not None
    initial = initial_path(tree.solver.model, node.problem, tree.solver.path_keyframes(node)[0])
    problem = path_problem(node.problem, initial, samples=1)
    return solve(tree.solver.model, [problem], [initial], tree.solver.settings)[0]


def _peer_row(solved: PeerSolution) -> Row:
    return {
        "feasible": solved.feasible,
        "seconds": solved.seconds,
        "evaluations": solved.evaluations,
        "equalities": solved.equalities,
        "inequalities": solved.inequalities,
    }


def _peer_path(
    peer: PeerScene,
    actions: Sequence[Action],
    problem: Problem,
    keyframes: PeerSolution,
    steps: int,
    seed: int,
) -> Row:
    """Path of `robotic` with a number of slices a phase, judged by the check and, where ours has as many, by ours.

    Costs of paths with any number of slices are those of the same motion in as many slices as our paths have.
    """
    solved = solve_peer(peer, build_path(peer, actions, keyframes, steps), seed)
    x = to_variables(problem, actions, solved)
    row = _peer_row(solved)

    # Second differences of a path with n times the slices are n^2 times smaller, and there are n times as many.
    finer = steps / STEPS_PER_PHASE
    row["cost"] = finer**3 * path_cost(np.asarray(problem.home), np.asarray(x.q))
    if steps == STEPS_PER_PHASE:
        row["our measure"] = judge_point(workcell_model(peer.scene.workcell), problem, x)
    row["passed"] = solved.feasible and _passes(peer.scene, actions, problem, x.q, x.m)
    return row


def compare(peer: PeerScene, actions: Sequence[Action], seed: int) -> Row:
    """Solve keyframes and path of one sequence by both solvers.

    Args:
        peer: the scene in `robotic`.
        actions: the sequence.
        seed: of both solvers.

    Returns:
        The results of both, "keyframes" and "path". A solver tries the path where its own keyframes are feasible.
    """
    scene = peer.scene
    problem = transcribe(scene, actions)

    tree, node, ours = _our_keyframes(scene, actions, seed)
    keyframes = solve_peer(peer, build_keyframes(peer, actions), seed)
    measured = judge_point(tree.solver.model, problem, to_variables(problem, actions, keyframes))
    theirs = {**_peer_row(keyframes), "our measure": measured}

    paths: Row = {}
    if node.feasible:
        paths["ours"] = _our_path(scene, node, lambda: run_alone(tree.solver.solve_path(node)))
        paths["ours optimal"] = _our_path(scene, node, lambda: _optimal_path(tree, node))
        paths["ours at slices"] = _our_path(scene, node, lambda: _path_at_slices(tree, node))
    if keyframes.feasible:
        paths["robotic"] = _peer_path(peer, actions, problem, keyframes, STEPS_PER_PHASE, seed)
        paths["robotic finer"] = _peer_path(
            peer, actions, problem, keyframes, FINER * STEPS_PER_PHASE, seed
        )

    return {
        "keyframes": {"ours": ours, "robotic": theirs},
        "path": paths,
    }
