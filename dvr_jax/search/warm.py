"""Compile, or load, all programs that searches on scenes of one size use: beforehand, or beside a search."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event, Thread

import jax
import jax.numpy as jnp

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import PARAMETERS, Variables
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.scene.types import Scene
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.tree import SequenceTree
from dvr_jax.seeds.initial_paths import path_problem, path_start
from dvr_jax.seeds.keyframe_beam import empty_prefix
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.continuous_collision import sample_penetration
from dvr_jax.solver.engine import extend_beams, solve, stack

_ready: set[tuple[int, int, Hashable]] = set()
"""Number of objects, number of actions and size of the network whose programs this process has."""


def warm_up(
    scene: Scene,
    k_max: int = 6,
    network: SequencePredictor[Images, Encoding] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Run every program once: one iteration of each NLP of 1 to ``k_max`` actions, one query of the network.

    Args:
        scene: any with the number of objects that is wanted; what it asks for is not solved.
        stop: asked between programs whether the rest is no longer needed.
    """
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
    lengths = range(1, k_max + 1)
    with jax.enable_x64(True):
        problems = {K: transcribe(scene, [actions[k % len(actions)] for k in range(K)]) for K in lengths}
        points = {K: Variables(jnp.tile(p.home, (K, 1)), jnp.zeros((K, PARAMETERS))) for K, p in problems.items()}

        def solve_keyframes(K: int) -> None:
            solve([problems[K]], [points[K]], once)

        def solve_path(K: int) -> None:
            begin = path_start(problems[K], points[K])
            path = path_problem(problems[K], begin)
            sample_penetration(stack([path]), stack([begin]))
            solve([path], [begin], once)

        def extend(lanes: int) -> None:
            beam = empty_prefix(len(scene.objects), k_max)
            for problem in problems.values():
                (beam,) = extend_beams([beam], [problem], 0, [lanes])

        # In the order in which a search comes to need them. One that is guided extends beam itself meanwhile; the
        # prefixes and paths that it then has to solve are seldom the shortest or the longest, so these come last.
        keyframes, paths = ([partial(call, K) for K in lengths] for call in (solve_keyframes, solve_path))
        one_by_one = [1] if batch_sizes().few else []
        extensions = [partial(extend, lanes) for lanes in (*one_by_one, batch_sizes().beam_lanes)]
        if network is None:
            jobs = [*keyframes, *reversed(extensions), *paths]
        else:
            middle_out = sorted(range(k_max), key=lambda k: abs(k - (k_max - 1.5) / 2))
            jobs = [call[k] for some in (middle_out[:-2], middle_out[-2:]) for call in (keyframes, paths) for k in some]
            jobs = [partial(_query, scene, k_max, network), *jobs, *extensions]
        for job in jobs:
            if stop():
                return
            job()
    _ready.add(_key(scene, k_max, network))


def _query(scene: Scene, k_max: int, network: SequencePredictor[Images, Encoding]) -> None:
    """Ask a network for one child and for as many as there may be."""
    tree = SequenceTree(scene, k_max)
    encoding = network.encode_scene(scene, tree.grounding)
    widest = len(list(tree.grounding.applicable(tree.grounding.initial_state)))
    for children in (1, widest):
        network.predict(encoding, encoding.initial_hidden(), range(children))


def _key(scene: Scene, k_max: int, network: SequencePredictor[Images, Encoding] | None) -> tuple[int, int, Hashable]:
    return len(scene.objects), k_max, None if network is None else network.size


@contextmanager
def warming_up(scene: Scene, k_max: int, network: SequencePredictor[Images, Encoding] | None) -> Iterator[None]:
    """Compile on another core what the work inside will soon need, unless this process has it."""
    if _key(scene, k_max, network) in _ready:
        yield
        return
    done = Event()
    thread = Thread(target=warm_up, args=(scene, k_max, network, done.is_set))
    thread.start()
    try:
        yield
    finally:
        # It ends with the program that it is at.
        done.set()
