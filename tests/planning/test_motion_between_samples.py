"""Between the slices of a path: penetrations as MuJoCo finds them, samples where they are, and no path called feasible
whose motion penetrates."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import mujoco
import numpy as np
import pytest
from search_cases import judge_prefixes

from dvr_jax.bench.problems import read_problems
from dvr_jax.checker import CheckReport
from dvr_jax.checker.replay import check_motion
from dvr_jax.checker.tolerances import DEEPEST_CONTACT
from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.nlp.blocks.rest import REST_TOLERANCE
from dvr_jax.planning.carried_objects import carry_objects
from dvr_jax.planning.path_motion import interpolate
from dvr_jax.runtime import batch_sizes
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.initial_paths import STEPS_PER_PHASE, initial_path, keyframe_start, path_problem
from dvr_jax.solver import lane_pool
from dvr_jax.solver.continuous_collision import (
    BETWEEN_TOLERANCE,
    PenetrationSamples,
    sample_penetration,
    straight_intervals,
)
from dvr_jax.solver.lane_pool import NlpSolution, solve
from dvr_jax.solver.state import Settings, SolverStatus

HANDOVERS = (193, 229)
"""Of the frozen problems, two of two actions whose first path penetrates between its samples, if no clearances are
kept."""


def without_clearances(scene: Scene) -> Scene:
    """The scene in a workcell whose motions need not keep any distance."""
    workcell = scene.workcell
    return replace(scene, workcell=replace(workcell, clearances=workcell.clearances.scaled(0)))


def states_at(scene: Scene, node: Node, path: NlpSolution, times: np.ndarray) -> np.ndarray:
    """States of a path at times in units of an interval, with the fingers as the NLP has them."""
    problem = node.problem
    assert problem is not None
    steps = len(path.q) // node.depth
    interval = np.ceil(times).astype(int) - 1
    phase = interval // steps
    opening = problem.finger_opening[phase]
    before_switch = interval % steps == steps - 1
    wider = np.maximum(opening, problem.finger_opening[phase + 1])
    opening = np.where(before_switch[:, None], wider, opening)

    curve = joint_curve(problem.home, path.q, straight_intervals(problem, len(path.q)))
    layout = qpos_layout(scene)
    qpos = np.zeros((len(times), layout.size))
    qpos[:, layout.arm_joints.reshape(-1)] = curve(times)
    qpos[:, layout.fingers.reshape(-1)] = np.repeat(opening, 2, axis=1)
    carry_objects(scene, problem, path.m, phase, qpos)
    return qpos


@pytest.fixture(scope="module", params=HANDOVERS)
def handover(request: pytest.FixtureRequest) -> tuple[Scene, SequenceTree, Node]:
    scene, actions, _ = next(islice(read_problems(), request.param, None))
    scene = without_clearances(scene)
    tree = SequenceTree(scene, k_max=6)
    return scene, tree, run_alone(judge_prefixes(tree, actions))


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[PenetrationSamples]]:
    """What a solver sees between slices, each time that it looks."""
    seen: list[PenetrationSamples] = []

    def look(*arguments: Any) -> PenetrationSamples:
        found = sample_penetration(*arguments)
        seen.append(found)
        return found

    monkeypatch.setattr(lane_pool, "sample_penetration", look)
    yield seen


def replay(scene: Scene, node: Node, path: NlpSolution) -> CheckReport:
    assert node.problem is not None
    return check_motion(scene, node.actions, interpolate(scene, node.problem, path.q, path.m))


def test_a_path_that_penetrates_between_its_samples_is_not_feasible(
    handover: tuple[Scene, SequenceTree, Node],
    looks: list[PenetrationSamples],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(lane_pool, "EXCHANGES", 0)
    scene, tree, node = handover
    path = run_alone(tree.solver.solve_path(node))
    fraction = looks[-1].fraction[0]
    depth = looks[-1].depth[0]
    assert depth.max() > BETWEEN_TOLERANCE
    assert (
        not path.feasible
        and path.status == SolverStatus.ITERATION_LIMIT
        and path.relative_violation > 1
    )
    model = build_model(scene)
    data = mujoco.MjData(model)
    # The capsules of closed fingers reach 1 mm into what they hold, which the planner does not count.
    deep = np.argwhere(depth > 1.2e-3)
    assert len(deep) > 5
    states = states_at(scene, node, path, np.array([t + fraction[t, look] for t, look in deep]))
    for (t, look), state in zip(deep, states, strict=True):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        assert depth[t, look] == pytest.approx(-data.contact.dist.min(), abs=1e-9)
    report = replay(scene, node, path)
    assert not report.passed and report.deepest_penetration > DEEPEST_CONTACT


def test_exchanged_samples_end_in_a_motion_without_penetration(
    handover: tuple[Scene, SequenceTree, Node], looks: list[PenetrationSamples]
) -> None:
    scene, tree, node = handover
    path = run_alone(tree.solver.solve_path(node))
    assert len(looks) > 1 and looks[0].depth.max() > BETWEEN_TOLERANCE
    assert path.feasible and path.status == SolverStatus.FEASIBLE and path.relative_violation <= 1
    assert replay(scene, node, path).deepest_penetration <= BETWEEN_TOLERANCE


def test_paths_side_by_side_are_those_one_by_one(
    looks: list[PenetrationSamples], monkeypatch: pytest.MonkeyPatch
) -> None:
    """More paths than lanes; some penetrate between their samples at first, and no lane is looked at without need."""
    monkeypatch.setenv("DVR_JAX_CACHE", "off")  # programs are kept by their shapes
    tasks = []
    rows = list(read_problems())
    paths_of_two = [
        i for i, (*_, row) in enumerate(rows) if (row["kind"], row["length"]) == ("path", 2)
    ]
    for scene, actions, _ in (rows[number] for number in (*HANDOVERS, *paths_of_two[:5])):
        scene = without_clearances(scene)
        tree = SequenceTree(scene, k_max=6)
        model = tree.solver.model
        node = run_alone(judge_prefixes(tree, actions))
        start = initial_path(model, node.problem, keyframe_start(node.beam, 0, 2))  # type: ignore[arg-type]
        tasks.append((path_problem(node.problem, start), start))  # type: ignore[arg-type]
    problems, starts = zip(*tasks, strict=True)
    alone = [
        result
        for problem, start in tasks
        for result in solve(model, [problem], [start], Settings())
    ]
    needed = len(looks)
    assert needed > len(tasks)
    monkeypatch.setattr(batch_sizes, "CPU", replace(batch_sizes.CPU, path_lanes=3))
    together = solve(model, problems, starts, Settings())
    assert len(looks) - needed <= needed
    for ours, theirs in zip(together, alone, strict=True):
        assert (ours.status, ours.iterations) == (theirs.status, theirs.iterations)
        np.testing.assert_allclose(ours.q, theirs.q, atol=1e-6)


def test_of_a_path_with_samples_at_its_slices_nothing_else_is_looked_at(
    handover: tuple[Scene, SequenceTree, Node], looks: list[PenetrationSamples]
) -> None:
    scene, tree, node = handover
    assert node.problem is not None and node.beam is not None
    start = initial_path(tree.solver.model, node.problem, keyframe_start(node.beam, 0, node.depth))
    (path,) = solve(
        tree.solver.model, [path_problem(node.problem, start, samples=1)], [start], Settings()
    )
    assert path.feasible and not looks
    assert replay(scene, node, path).deepest_penetration > DEEPEST_CONTACT


def test_a_motion_starts_and_ends_at_rest_and_keeps_to_the_limits(
    handover: tuple[Scene, SequenceTree, Node],
) -> None:
    scene, tree, node = handover
    path = run_alone(tree.solver.solve_path(node))
    assert path.feasible and np.abs(path.q[-1] - path.q[-2]).max() < REST_TOLERANCE
    report = replay(scene, node, path)
    # These are first actions of longer sequences: at their end the goal's object is still held.
    assert {finding.kind for finding in report.findings} <= {
        "goal held",
        *(f"support {kind}" for kind in ("tilt", "height", "overhang")),
    }
    curve = joint_curve(np.asarray(node.problem.home), path.q)  # type: ignore[union-attr]
    np.testing.assert_allclose(curve(0.0, 1), 0, atol=1e-12)


def test_samples_of_a_start_lie_on_the_line_where_it_rests(
    handover: tuple[Scene, SequenceTree, Node],
) -> None:
    """In the interval before a switch, in which solutions rest too: a sample beside the resting motion would ask for
    a clearance that a placed object cannot have."""
    _, tree, node = handover
    assert node.problem is not None and node.beam is not None
    start = initial_path(tree.solver.model, node.problem, keyframe_start(node.beam, 0, node.depth))
    path = path_problem(node.problem, start)
    for last in range(STEPS_PER_PHASE - 1, len(start.q), STEPS_PER_PHASE):
        np.testing.assert_array_equal(start.q[last], start.q[last - 1])
        np.testing.assert_allclose(path.sample_offset[last], 0, atol=1e-15)
    assert np.abs(path.sample_offset).max() > 1e-3
