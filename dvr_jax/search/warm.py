"""Compile, or load, all programs that searches on scenes of one size use: beforehand, or beside a search."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

import jax
import jax.numpy as jnp

from dvr_jax.komo.augmented import Settings
from dvr_jax.komo.between import look_between
from dvr_jax.komo.engine import EXTENSION_LANES, extend_prefixes, path_problem, path_start, solve, stack
from dvr_jax.komo.particles import empty_prefix
from dvr_jax.komo.problem import PARAMETERS, Variables
from dvr_jax.komo.transcription import transcribe
from dvr_jax.logic import Action
from dvr_jax.scene.types import Scene
from dvr_jax.search.reasoning import Network
from dvr_jax.search.tree import SequenceTree

_ready: set[tuple[int, int, object]] = set()
"""Number of objects, number of actions and network whose programs this process has."""


def warm_up(
    scene: Scene,
    k_max: int = 6,
    network: Network | None = None,
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
    with jax.enable_x64(True):
        problems = [transcribe(scene, [actions[k % len(actions)] for k in range(K)]) for K in range(1, k_max + 1)]
        keyframes = [Variables(jnp.tile(p.home, (K, 1)), jnp.zeros((K, PARAMETERS))) for K, p in enumerate(problems, 1)]
        # In the order in which a search comes to need them.
        for problem, point in zip(problems, keyframes, strict=True):
            if stop():
                return
            solve([problem], [point], once)
        particles = empty_prefix(len(scene.objects), k_max)
        for problem in problems:
            if stop():
                return
            for lanes in (EXTENSION_LANES, 1):
                (child,) = extend_prefixes([particles], [problem], 0, [lanes])
            particles = child
        if network is not None:
            tree = SequenceTree(scene, k_max)
            code = network.begin(scene, tree.grounding)
            widest = len(list(tree.grounding.applicable(tree.grounding.initial_state)))
            for children in (1, widest):
                network.step(code, code.initial_hidden(), range(children))
        starts = [path_start(problem, point) for problem, point in zip(problems, keyframes, strict=True)]
        for problem, point in zip(problems, starts, strict=True):
            if stop():
                return
            path = path_problem(problem, point)
            solve([path], [point], once)
            look_between(stack([path]), stack([point]))
    _ready.add(_key(scene, k_max, network))


def _key(scene: Scene, k_max: int, network: Network | None) -> tuple[int, int, object]:
    return len(scene.objects), k_max, None if network is None else id(network)


@contextmanager
def warming_up(scene: Scene, k_max: int, network: Network | None) -> Iterator[None]:
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
