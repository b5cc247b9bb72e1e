"""Extending the beams of lists of prefixes: all calls have the same number of lanes, so that little is compiled.

The interface between search (lists of Python objects) and compiled code (stacked arrays). What a prefix gets does not
depend on what else is in the lists.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem, number_of_phases
from dvr_jax.operators.proposal import BeamStep, Proposal
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import to_device
from dvr_jax.seeds.keyframe_beam import (
    PENETRATION,
    KeyframeBeam,
    empty_candidates,
    extend_beam,
    random_shape,
)
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.workcell.model import WorkcellModel

MEETING_FORWARD = 0.45
"""How far in front of the bases two arms that look the same way meet [m]."""


@dataclass(frozen=True, slots=True)
class BeamTask:
    """One prefix whose beam is wanted."""

    parent: KeyframeBeam
    """Beam of the prefix without its last action."""

    problem: Problem
    """Keyframe NLP of the whole prefix."""

    proposal: Proposal
    """How its last action is sampled."""


def _program_key(task: BeamTask) -> tuple[Proposal, int]:
    """How the last action is sampled, and how many actions are before it: one call serves what is equal in both."""
    return task.proposal, number_of_phases(task.problem) - 1


def extend_beams(model: WorkcellModel, tasks: Sequence[BeamTask], seed: int) -> list[KeyframeBeam]:
    """Beams of prefixes, in the order of the tasks.

    Args:
        model: Arms of the workcell that all prefixes share.
        tasks: Prefixes with the same number of objects.
        seed: Of the sample.
    """
    # The model goes to every program of an extension, so it is converted once.
    model = to_device(model)

    groups: dict[tuple[Proposal, int], list[int]] = {}
    for index, task in enumerate(tasks):
        groups.setdefault(_program_key(task), []).append(index)

    count = batch_sizes().beam_lanes
    beams: dict[int, KeyframeBeam] = {}
    for (_, depth), members in groups.items():
        uniform = np.random.default_rng([seed, depth]).random(random_shape(model), np.float32)
        for first in range(0, len(members), count):
            indices = members[first : first + count]
            found = _extend_batch(model, [tasks[index] for index in indices], count, uniform)
            beams.update(zip(indices, found, strict=True))
    return [beams[index] for index in range(len(tasks))]


def _extend_batch(
    model: WorkcellModel, tasks: Sequence[BeamTask], count: int, uniform: np.ndarray
) -> list[KeyframeBeam]:
    """Beams of prefixes that one call serves, filled up to a number of lanes."""
    padded = [*tasks, *[tasks[0]] * (count - len(tasks))]
    steps = _stack([beam_step(task.problem, task.proposal) for task in padded])
    parents = _stack([task.parent for task in padded])
    supports = _supports_of_candidates(padded)
    extended = extend_beam(model, parents, steps, uniform, tasks[0].proposal, supports)
    batch = jax.tree.map(np.asarray, extended)
    return [jax.tree.map(lambda leaf, lane=lane: leaf[lane], batch) for lane in range(len(tasks))]


def _supports_of_candidates(
    tasks: Sequence[BeamTask],
) -> Float[np.ndarray, "prefixes candidates 5"] | None:
    """Return the rectangles on which the last actions place their objects, in every candidate of the parents.

    A lower object stands where the parent's candidates have placed it. Without objects as supports the result is None.
    """
    if tasks[0].problem.top_object.shape[-1] == 0:
        return None

    found = []
    for task in tasks:
        k = number_of_phases(task.problem) - 1
        lower = int(task.problem.top_object[k, 0])
        areas = np.repeat(task.problem.support[None, k], len(task.parent.violation), axis=0)
        is_on_top = task.problem.top_half[k, 0, 0] > 0
        if is_on_top and task.parent.kind[lower] == ModeKind.PLACED:
            areas[:, :3] = task.parent.parameters[:, lower, :3]
        found.append(areas)
    return np.stack(found).astype(np.float32)


def prepare_penetration(model: WorkcellModel, task: BeamTask) -> None:
    """Load or compile the program that measures distances, the most expensive one of an extension.

    Args:
        model: Arms of the workcell.
        task: Any prefix of the size that is wanted.
    """
    count = batch_sizes().beam_lanes
    steps = _stack([beam_step(task.problem, task.proposal)] * count)
    parents = _stack([task.parent] * count)
    PENETRATION.prepare(to_device(model), parents, steps, empty_candidates(parents))


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def beam_step(problem: Problem, proposal: Proposal) -> BeamStep:
    """Arrays of a problem's last action, without the axis of prefixes.

    Args:
        problem: Keyframe NLP of a prefix.
        proposal: How its last action is sampled.
    """
    k = number_of_phases(problem) - 1
    item = int(problem.switched_object[k])
    acting = int(problem.acting_arm[k])
    is_held = int(problem.mode_kind[k, item]) == ModeKind.HELD
    giving = int(problem.mode_parent[k, item]) if is_held else 0
    center, axis = _meeting_region(problem, acting, giving)

    def number(value: Any) -> np.ndarray:
        return np.asarray(value, np.float32)

    return BeamStep(
        prism=number(problem.prism),
        initial_pose=number(problem.initial_pose),
        fixed_prism=number(problem.fixed_prism),
        fixed_pose=number(problem.fixed_pose),
        base_rotation=number(problem.base_rotation),
        base_position=number(problem.base_position),
        home=number(problem.home),
        clearance=number(problem.clearance[k]),
        finger_opening=number(np.maximum(problem.finger_opening[k], problem.finger_opening[k + 1])),
        depth=np.int32(k),
        acting_arm=np.int32(acting),
        giving_arm=np.int32(giving),
        item=np.int32(item),
        kind_after=np.int32(problem.mode_kind[k + 1, item]),
        parent_after=np.int32(problem.mode_parent[k + 1, item]),
        closing_yaw=number(problem.closing_yaw[k]),
        parameter_lower=number(problem.parameter_lower[k]),
        parameter_upper=number(problem.parameter_upper[k]),
        support=number(problem.support[k]),
        inner_prism=number(problem.inner_prism[k]),
        kept_clear=number(problem.kept_clear[k]),
        meeting_center=number(center),
        meeting_axis=number(axis),
        sibling_penalty=number(proposal.sibling_penalty),
    )


def _meeting_region(problem: Problem, acting: int, giving: int) -> tuple[np.ndarray, np.ndarray]:
    """Where two arms meet: center (2,) [m], and direction (2,) of the line through their bases.

    Arms that face each other meet in the middle, arms that look the same way in front of their middle.
    """
    first = min(acting, giving)
    second = max(acting, giving)
    bases = np.asarray(problem.base_position)[:, :2]
    forward = np.asarray(problem.base_rotation)[:, :2, 0]
    line = bases[second] - bases[first]
    length = math.hypot(*line)
    axis = line / length if length > 0 else np.array([1.0, 0.0])
    ahead = (forward[first] + forward[second]) / 2
    return (bases[first] + bases[second]) / 2 + MEETING_FORWARD * ahead, axis


def adopt_solution(beam: KeyframeBeam, problem: Problem, solution: NlpSolution) -> KeyframeBeam:
    """The beam with a solution of the keyframe NLP in the place of its worst candidate.

    Args:
        beam: Beam of a prefix.
        problem: Keyframe NLP of the prefix.
        solution: A feasible solution of it.
    """
    K = len(solution.m)
    worst = int(np.argmax(beam.violation))
    q = np.array(beam.q)
    m = np.array(beam.m)
    violation = np.array(beam.violation)
    parameters = np.array(beam.parameters)
    q[worst, :K] = solution.q
    m[worst, :K] = solution.m
    violation[worst] = 0
    for item, action in enumerate(problem.mode_action[K]):
        parameters[worst, item] = solution.m[action]
    return beam._replace(q=q, m=m, violation=violation, parameters=parameters)
