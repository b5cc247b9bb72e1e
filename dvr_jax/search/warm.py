"""Compile, or load, all programs that searches on scenes of one size use, so that what follows is timed without."""

from __future__ import annotations

import jax

from dvr_jax.komo.augmented import Settings
from dvr_jax.komo.engine import extend_prefixes, keyframe_start, path_problem, path_start, refined_start, solve
from dvr_jax.komo.particles import empty_prefix
from dvr_jax.komo.transcription import transcribe
from dvr_jax.logic import Action
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.search.reasoning import Network
from dvr_jax.search.tree import SequenceTree


def warm_up(number_of_objects: int, k_max: int = 6, network: Network | None = None) -> None:
    """Run every program once: one iteration of each NLP of 1 to ``k_max`` actions, one query of the network."""
    scene = next(sample_scenes(1, number_of_objects, seed=0))
    name = scene.goal.object
    # Whether these can be done does not matter; all kinds of extension occur.
    actions = [
        Action("grasp", ("left", "+x", name)),
        Action("grasp", ("right", "+y", name)),
        Action("place", ("right", name, "table")),
        Action("grasp", ("left", "+x", name)),
        Action("grasp", ("right", "+y", name)),
        Action("place", ("right", name, "goal")),
    ]
    once = Settings(iteration_limit=1)
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max)
        particles = empty_prefix(number_of_objects, k_max)
        for length in range(1, k_max + 1):
            prefix = [actions[k % len(actions)] for k in range(length)]
            problem = transcribe(scene, prefix)
            particles = extend_prefixes([particles], [problem], seed=0)[0]
            keyframes = keyframe_start(particles, 0, length)
            solve([problem], [keyframes], once)
            start = path_start(problem, keyframes)
            path = solve([path_problem(problem, start)], [start], once)[0]
            finer = refined_start(problem, path)
            solve([path_problem(problem, finer)], [finer], once)
        if network is not None:
            code = network.begin(scene, tree.grounding)
            network.step(code, code.initial_hidden(1), [0])
