"""Synthetic labelled sequences in the data set's form, for the tests of the network."""

import numpy as np

from dvr_jax.dataset import Examples
from dvr_jax.logic import enumerate_sequences
from dvr_jax.operators import ground_scene
from dvr_jax.scene.sampling import sample_scenes


def sided_examples(number: int, seed: int, objects: int = 2, longest: int = 2) -> Examples:
    """All sequences of 2 to `longest` actions of scenes in which a sequence is feasible if it has two actions and uses
    the arm on whose side the goal's object stands."""
    scenes = list(sample_scenes(number, objects, seed))
    rows, labels = [], []
    for i, scene in enumerate(scenes):
        grounding = ground_scene(scene)
        arm = "left" if scene.objects[scene.goal_index].position[0] < 0 else "right"
        sequences = [s for length in range(2, longest + 1) for s in enumerate_sequences(grounding, length)]
        feasible = [len(s) == 2 and grounding.actions[s[0]].arguments[0] == arm for s in sequences]
        good = {s[:j] for s, f in zip(sequences, feasible, strict=True) if f for j in range(1, len(s) + 1)}
        for sequence, label in zip(sequences, feasible, strict=True):
            rows.append((i, sequence, [sequence[: j + 1] in good for j in range(len(sequence))]))
            labels.append(label)
    count = len(rows)
    actions, targets = np.full((count, longest), -1, np.int32), np.zeros((count, longest), np.float32)
    for row, (_, sequence, promising) in enumerate(rows):
        actions[row, : len(sequence)], targets[row, : len(sequence)] = sequence, promising
    return Examples(
        scenes,
        np.array([scene for scene, _, _ in rows], np.int32),
        actions,
        targets,
        np.arange(longest) < np.array([[len(sequence)] for _, sequence, _ in rows]),
        np.array([0 if label else len(row[1]) for row, label in zip(rows, labels, strict=True)], np.int32),
        np.array([len(sequence) for _, sequence, _ in rows], np.int32),
        np.array(labels),
    )
