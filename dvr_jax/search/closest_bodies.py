"""Which bodies are too close to each other at a point of an NLP, by name."""

from __future__ import annotations

import jax
import numpy as np
from jaxtyping import Float

from dvr_jax.nlp.collision_rows import capsule_pairs, object_pairs, table_capsules
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.scene.types import Scene
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk
from dvr_jax.solver.lane_pool import NlpSolution, stack
from dvr_jax.workcell.model import workcell_model

TABLE = "table"
"""Name of the table in reasons."""


def deepest_contact(
    scene: Scene, problem: Problem, solution: NlpSolution
) -> tuple[int, tuple[str, str], float]:
    """Return the slice, the bodies and the depth of the deepest penetration of keyframes [m].

    Args:
        scene: A valid scene.
        problem: The keyframe NLP.
        solution: A point of it.
    """
    distance = keyframe_distances(scene, problem, solution)
    index = int(np.argmin(distance))
    slice_index, row = divmod(index, distance.shape[1])
    first, second = _row_names(scene)[row]
    return slice_index, (first, second), float(-distance[slice_index, row])


def keyframe_distances(
    scene: Scene, problem: Problem, solution: NlpSolution
) -> Float[np.ndarray, "slices rows"]:
    """Return the distances of all bodies less their clearances at each slice of keyframes [m]."""
    with jax.enable_x64(True):
        model = workcell_model(scene.workcell)
        x = stack([Variables(solution.q, solution.m)])
        chunks = lay_out_chunks(stack([problem]), x)
        found = [np.asarray(measure_chunk(model, chunk).distance) for chunk in chunks]
    return np.concatenate(found)[: len(solution.q)]


def _row_names(scene: Scene) -> list[tuple[str, str]]:
    """Return the names of the two bodies of each distance, in the order of `dvr_jax.nlp.collision_rows`."""
    structure = workcell_model(scene.workcell).structure
    capsules = [
        f"{arm.name} {_part(name)}"
        for arm in scene.workcell.arms
        for name in scene.workcell.robot.capsules.names
    ]
    bodies = [*scene.object_names, *(body.name for body in scene.fixed)]
    first, second = capsule_pairs(structure)
    names = [(capsules[i], capsules[j]) for i, j in zip(first, second, strict=True)]
    names += [(capsules[i], TABLE) for i in table_capsules(structure)]
    names += [(capsule, body) for body in bodies for capsule in capsules]
    names += [(name, TABLE) for name in scene.object_names]
    pairs = object_pairs(len(scene.objects), len(scene.fixed))
    names += [(bodies[i], bodies[j]) for i, j in zip(*pairs, strict=True)]
    return names


def _part(capsule: str) -> str:
    """Return the part of an arm that a capsule belongs to, in words."""
    return "hand" if capsule.startswith(("hand", "finger")) else capsule.split("_")[0]
