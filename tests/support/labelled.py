"""Synthetic labelled sequences in the data set's form, for the tests of the network."""

import numpy as np

from dvr_jax.dataset.examples import Examples
from dvr_jax.logic import enumerate_sequences
from dvr_jax.operators import ground_scene
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Scene


def sided_examples(number: int, seed: int, objects: int = 2, longest: int = 2) -> Examples:
    """All sequences of 2 to `longest` actions of scenes with a rule that is easy to learn.

    A sequence is feasible if it has two actions and uses the arm on whose side the goal's object stands.
    """
    scenes = list(sample_scenes(number, objects, seed))
    scene_indices: list[int] = []
    sequences: list[tuple[int, ...]] = []
    verdicts: list[bool] = []
    promising: list[list[bool]] = []
    for index, scene in enumerate(scenes):
        own, feasible = sided_sequences(scene, longest)
        solutions = [sequence for sequence, verdict in zip(own, feasible, strict=True) if verdict]
        prefixes = {
            solution[:length] for solution in solutions for length in range(1, len(solution) + 1)
        }
        for sequence in own:
            promising.append([sequence[: step + 1] in prefixes for step in range(len(sequence))])
        scene_indices += [index] * len(own)
        sequences += own
        verdicts += feasible

    length = np.array([len(sequence) for sequence in sequences], np.int32)
    actions = np.full((len(sequences), longest), -1, np.int32)
    targets = np.zeros((len(sequences), longest), np.float32)
    for row, sequence in enumerate(sequences):
        actions[row, : len(sequence)] = sequence
        targets[row, : len(sequence)] = promising[row]

    feasible_array = np.array(verdicts)
    return Examples(
        scenes=scenes,
        scene=np.array(scene_indices, np.int32),
        actions=actions,
        targets=targets,
        weight=np.arange(longest) < length[:, None],
        refuted_after=np.where(feasible_array, 0, length).astype(np.int32),
        length=length,
        feasible=feasible_array,
    )


def sided_sequences(scene: Scene, longest: int) -> tuple[list[tuple[int, ...]], list[bool]]:
    """The sequences of one scene and whether each is feasible."""
    grounding = ground_scene(scene)
    arm = "left" if scene.objects[scene.goal_index].position[0] < 0 else "right"
    sequences = [
        sequence
        for length in range(2, longest + 1)
        for sequence in enumerate_sequences(grounding, length)
    ]
    feasible = [
        len(sequence) == 2 and grounding.actions[sequence[0]].arguments[0] == arm
        for sequence in sequences
    ]
    return sequences, feasible
