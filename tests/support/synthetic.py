"""Labels as a breadth-first sweep would write them, with a die in place of the solver."""

import math
import random
from collections import deque

from dvr_jax.dataset.labels import Label
from dvr_jax.dataset.sequence_index import sequence_index_of
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Scene

OPTIONS = {"seed": 1, "objects": 2, "k_max": 6, "solutions": 4}


def sweep_scene(
    scene: Scene, index: int, rows: int = 100, k_max: int = 6, seed: int = 0
) -> list[Label]:
    sequences = sequence_index_of(scene)
    grounding, generator = sequences.grounding, random.Random(f"sweep {seed} {index}")
    labels: list[Label] = []
    queue: deque[tuple[tuple[int, ...], int]] = deque([((), grounding.initial_state)])
    while queue:
        prefix, state = queue.popleft()
        for action in grounding.applicable(state):
            actions, after = (*prefix, action), grounding.successor(state, action)
            goal, refuted = grounding.is_goal(after), generator.random() < 0.8
            if not grounding.can_reach_goal(after, k_max - len(actions)):
                continue
            if not goal and not refuted:
                queue.append((actions, after))
                continue
            feasible = goal and generator.random() < 0.15
            bound = (
                ""
                if feasible
                else "path"
                if goal
                else generator.choice(["symbolic", "pose", "sequence"])
            )
            violation = (
                math.nan
                if bound == "symbolic"
                else math.exp(generator.gauss(-3 if feasible else 3, 1))
            )
            words = tuple(str(grounding.actions[i]) for i in actions)
            labels.append(Label(index, words, feasible, not goal, bound, violation))
            if len(labels) == rows:
                return labels
    return labels


def synthetic(
    first: int, stop: int, rows: int = 100, objects: int = 2
) -> tuple[dict[int, Scene], list[Label]]:
    scenes = dict(list(enumerate(sample_scenes(stop, objects, seed=1)))[first:])
    return scenes, [
        label for index, scene in scenes.items() for label in sweep_scene(scene, index, rows)
    ]
