"""Figures of merit of a network on held-out sequences and scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from dvr_jax.dataset.examples import Examples
from dvr_jax.logic import Action
from dvr_jax.model.batches import assemble_batch
from dvr_jax.model.greedy import greedy_sequences
from dvr_jax.model.kind import Kind
from dvr_jax.model.metrics import average_precision
from dvr_jax.model.network import NetworkParameters
from dvr_jax.model.scene_table import SceneTable
from dvr_jax.model.training import evaluate_batch
from dvr_jax.scene.types import Scene

VALIDATION_BATCH = 64
"""Number of held-out sequences that are predicted together."""

FeasibilityOracle = Callable[[Sequence[tuple[Scene, tuple[Action, ...]]]], Sequence[bool]]
"""Returns for each pair of a scene and a sequence of actions whether the sequence is feasible."""

SceneSequence = tuple[int, tuple[int, ...]]
"""Index of a scene, and a sequence as indices into the actions of its grounding."""


@dataclass(frozen=True)
class Validation:
    """Held-out sequences and scenes, of which at most some thousand, evenly spread, are looked at."""

    examples: Examples
    """Labelled sequences."""

    table: SceneTable
    """The scenes of the examples."""

    sequences: Int[np.ndarray, " sequences"]
    """Indices of the sequences that are predicted."""

    kind: Kind
    """Kind of the network."""

    positive_weight: float
    """Weight of targets of 1 in the loss."""

    solutions: dict[int, frozenset[tuple[int, ...]]]
    """Feasible sequences, by the labels, of each scene that is searched greedily."""

    oracle: FeasibilityOracle | None
    """Decides about greedy sequences that no label knows as feasible; without it they count as infeasible."""

    oracle_verdicts: dict[SceneSequence, bool] = field(default_factory=dict)
    """Verdicts of the oracle so far."""

    @staticmethod
    def from_examples(
        examples: Examples,
        table: SceneTable,
        sequences: Int[np.ndarray, " sequences"],
        kind: Kind,
        positive_weight: float,
        most_sequences: int,
        most_scenes: int,
        oracle: FeasibilityOracle | None = None,
    ) -> Validation:
        """Choose sequences and scenes among the held-out ones.

        Args:
            examples: Labelled sequences.
            table: The scenes of the examples.
            sequences: Indices of the held-out sequences.
            kind: Kind of the network.
            positive_weight: Weight of targets of 1 in the loss.
            most_sequences: Largest number of sequences that are predicted.
            most_scenes: Largest number of scenes with a solution that are searched greedily.
            oracle: Decides about greedy sequences that no label knows as feasible.

        Returns:
            The validation.
        """
        # A classifier does not predict what leads to the goal, so there is no greedy sequence to follow.
        most_scenes = most_scenes if kind == "dvr" else 0
        solutions = _feasible_sequences(examples, sequences)
        scenes = _evenly_spaced(np.array(sorted(solutions), np.int64), most_scenes)
        return Validation(
            examples=examples,
            table=table,
            sequences=_evenly_spaced(sequences, most_sequences),
            kind=kind,
            positive_weight=positive_weight,
            solutions={int(scene): frozenset(solutions[int(scene)]) for scene in scenes},
            oracle=oracle,
        )

    def measure(self, parameters: NetworkParameters) -> dict[str, float]:
        """Measure a network.

        Args:
            parameters: Parameters of the network.

        Returns:
            "loss"; "average_precision" of the actions whose targets have the full weight, which are the known targets
            if unknown ones weigh less; and, for a dvr network, "top1": the fraction of scenes with a solution in which
            the greedy sequence is feasible.
        """
        figures = self._measure_predictions(parameters)
        if self.solutions:
            k_max = self.examples.actions.shape[1]
            greedy = greedy_sequences(parameters, self.table, list(self.solutions), k_max)
            feasible = self._are_feasible(list(zip(self.solutions, greedy, strict=True)))
            figures["top1"] = float(np.mean(feasible))
        return figures

    def _measure_predictions(self, parameters: NetworkParameters) -> dict[str, float]:
        """Return loss and average precision over all held-out sequences."""
        losses: list[float] = []
        denominators: list[float] = []
        labels: list[np.ndarray] = []
        scores: list[np.ndarray] = []
        positive_weight = jnp.float32(self.positive_weight)

        for first in range(0, len(self.sequences), VALIDATION_BATCH):
            sequences = self.sequences[first : first + VALIDATION_BATCH]

            # The last batch is filled up with a sequence of weight 0, so that one shape is compiled.
            missing = VALIDATION_BATCH - len(sequences)
            filled = np.append(sequences, np.full(missing, self.sequences[0]))
            batch = assemble_batch(self.examples, self.table, filled, self.kind)
            is_counted = np.arange(VALIDATION_BATCH) < len(sequences)
            batch = batch._replace(weight=batch.weight * is_counted[:, None])

            loss, denominator, logits = evaluate_batch(
                parameters,
                self.table.height,
                self.table.masks,
                batch,
                positive_weight,
            )

            # Unknown targets have a smaller weight in the loss and do not count here.
            has_full_weight = batch.weight == 1
            losses.append(float(loss) * float(denominator))
            denominators.append(float(denominator))
            labels.append(batch.target[has_full_weight] > 0.5)
            scores.append(np.asarray(logits)[has_full_weight])

        return {
            "loss": sum(losses) / sum(denominators),
            "average_precision": average_precision(np.concatenate(labels), np.concatenate(scores)),
        }

    def _are_feasible(self, tasks: Sequence[SceneSequence]) -> list[bool]:
        """Return verdicts by the labels or else by the oracle, which is asked about nothing twice."""
        by_labels = [sequence in self.solutions[scene] for scene, sequence in tasks]
        if self.oracle is not None:
            unknown = [
                task
                for task, feasible in zip(tasks, by_labels, strict=True)
                if not feasible and task[1] and task not in self.oracle_verdicts
            ]
            if unknown:
                verdicts = self.oracle([self._with_actions(task) for task in unknown])
                self.oracle_verdicts.update(zip(unknown, verdicts, strict=True))

        return [
            feasible or self.oracle_verdicts.get(task, False)
            for task, feasible in zip(tasks, by_labels, strict=True)
        ]

    def _with_actions(self, task: SceneSequence) -> tuple[Scene, tuple[Action, ...]]:
        """Return the scene and the actions that the indices stand for."""
        scene, sequence = task
        actions = self.table.groundings[scene].actions
        return self.examples.scenes[scene], tuple(actions[index] for index in sequence)


def _feasible_sequences(
    examples: Examples,
    sequences: Int[np.ndarray, " sequences"],
) -> dict[int, set[tuple[int, ...]]]:
    """Return the feasible ones among these sequences, by scene."""
    found: dict[int, set[tuple[int, ...]]] = {}
    for index in sequences[examples.feasible[sequences]]:
        scene = int(examples.scene[index])
        actions = examples.actions[index, : examples.length[index]]
        found.setdefault(scene, set()).add(tuple(actions.tolist()))
    return found


def _evenly_spaced(values: Int[np.ndarray, " values"], most: int) -> Int[np.ndarray, " chosen"]:
    """Return at most so many of the values, evenly spaced."""
    if len(values) <= most:
        return values
    return values[np.linspace(0, len(values) - 1, most).astype(int)]
