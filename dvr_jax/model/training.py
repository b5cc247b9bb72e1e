"""Training: the loss, one step of Adam, and figures of merit on held-out scenes.

Loss of a batch, with s_bk the logit of sequence b at step k, f_bk its target, m_bk 1 where the step counts:

    w_bk = m_bk (positive_weight if f_bk = 1 else 1),      sum_bk w_bk BCE(s_bk, f_bk) / sum_bk w_bk
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from dvr_jax.dataset import Examples
from dvr_jax.logic import Action
from dvr_jax.model.batches import Batch, SceneTable, assemble_batch
from dvr_jax.model.metadata import Kind
from dvr_jax.model.metrics import average_precision, greedy_sequences
from dvr_jax.model.network import NetworkParameters, ParameterTree, encode_images, encode_symbols, run_sequence
from dvr_jax.scene.types import Scene

VALIDATION_BATCH = 64

ADAM = optax.scale_by_adam()

FeasibilityOracle = Callable[[Sequence[tuple[Scene, tuple[Action, ...]]]], Sequence[bool]]
"""Says of sequences of scenes whether they are feasible."""


def batch_logits(weights: NetworkParameters, height: jax.Array, masks: jax.Array, batch: Batch) -> jax.Array:
    """Logits (B, K) of a batch, its images taken from heights (S, H, W) and masks (S, M, H, W)."""
    shown = (batch.view_scene, batch.view_mirrored, batch.image_view, batch.image_pair)
    codes = encode_images(weights, height, masks, *(jnp.asarray(value) for value in shown))
    symbols = encode_symbols(weights, jnp.asarray(batch.symbol), jnp.asarray(batch.normal))
    return run_sequence(weights, symbols, codes[jnp.asarray(batch.image)], codes[jnp.asarray(batch.goal_image)])


def weighted_loss(
    logits: jax.Array,
    target: jax.Array | NDArray[np.float32],
    mask: jax.Array | NDArray[np.float32],
    positive_weight: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """The loss above () and its denominator (), from arrays (B, K)."""
    weight = mask * jnp.where(target > 0.5, positive_weight, jnp.float32(1.0))
    total = jnp.sum(weight)
    return jnp.sum(weight * optax.sigmoid_binary_cross_entropy(logits, jnp.asarray(target))) / total, total


@jax.jit
def evaluate_batch(
    weights: NetworkParameters, height: jax.Array, masks: jax.Array, batch: Batch, positive_weight: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Loss () of a batch, the sum of weights () it is a mean over, and logits (B, K)."""
    logits = batch_logits(weights, height, masks, batch)
    loss, total = weighted_loss(logits, batch.target, batch.mask, positive_weight)
    return loss, total, logits


@partial(jax.jit, donate_argnums=(0, 1))
def train_step(
    weights: NetworkParameters,
    optimizer: Any,
    height: jax.Array,
    masks: jax.Array,
    batch: Batch,
    learning_rate: jax.Array,
    positive_weight: jax.Array,
) -> tuple[NetworkParameters, Any, jax.Array]:
    """NetworkParameters and Adam's state after one step, and the loss () before it. Consumes weights and state."""

    def loss(parameters: ParameterTree) -> jax.Array:
        logits = batch_logits(NetworkParameters(parameters, weights.config), height, masks, batch)
        return weighted_loss(logits, batch.target, batch.mask, positive_weight)[0]

    value, gradient = jax.value_and_grad(loss)(weights.tree)
    direction, optimizer = ADAM.update(gradient, optimizer)
    parameters = jax.tree.map(lambda old, d: old - learning_rate * d, weights.tree, direction)
    return NetworkParameters(parameters, weights.config), optimizer, value


@dataclass(frozen=True)
class Validation:
    """Held-out sequences: rows of the examples, of which at most some thousand, evenly spread, are looked at."""

    examples: Examples
    table: SceneTable
    rows: NDArray[np.integer]
    """Sequences that are predicted (m,)."""
    kind: Kind
    positive_weight: float
    solutions: dict[int, frozenset[tuple[int, ...]]]
    """Feasible sequences, by the labels, of the scenes that are searched greedily."""
    judge: FeasibilityOracle | None
    """Asked about greedy sequences that are none of these; without it they count as infeasible."""
    judged: dict[tuple[int, tuple[int, ...]], bool] = field(default_factory=dict)
    """What it has said of scene and sequence."""

    @staticmethod
    def of(
        examples: Examples,
        table: SceneTable,
        rows: NDArray[np.integer],
        kind: Kind,
        positive_weight: float,
        most_sequences: int,
        most_scenes: int,
        judge: FeasibilityOracle | None = None,
    ) -> Validation:
        """At most so many of the sequences `rows`, and at most so many of their scenes that have a solution."""
        found: dict[int, set[tuple[int, ...]]] = {}
        for row in rows[np.asarray(examples.feasible)[rows]]:
            sequence = tuple(int(action) for action in examples.actions[row, : examples.length[row]])
            found.setdefault(int(examples.scene[row]), set()).add(sequence)
        # A classifier does not say what leads to the goal: there is no sequence to follow.
        scenes = _spread(np.array(sorted(found), np.int64), most_scenes if kind == "dvr" else 0)
        solutions = {int(scene): frozenset(found[int(scene)]) for scene in scenes}
        return Validation(examples, table, _spread(rows, most_sequences), kind, positive_weight, solutions, judge)

    def measure(self, weights: NetworkParameters) -> dict[str, float]:
        """Loss, average precision of the steps of full weight (where unknown targets weigh less: of the known ones)
        and, of a dvr network, the share of scenes with a solution in which the greedy sequence is feasible."""
        losses, totals, labels, scores = [], [], [], []
        scale = jnp.float32(self.positive_weight)
        for first in range(0, len(self.rows), VALIDATION_BATCH):
            rows = self.rows[first : first + VALIDATION_BATCH]
            # The last batch is filled up with the first row, which then counts nothing: one shape for all.
            filled = np.append(rows, np.full(VALIDATION_BATCH - len(rows), self.rows[0]))
            batch = assemble_batch(self.examples, self.table, filled, self.kind)
            batch = batch._replace(mask=batch.mask * (np.arange(VALIDATION_BATCH) < len(rows))[:, None])
            loss, total, logits = evaluate_batch(weights, self.table.height, self.table.masks, batch, scale)
            counts = batch.mask == 1
            losses.append(float(loss) * float(total))
            totals.append(float(total))
            labels.append(batch.target[counts] > 0.5)
            scores.append(np.asarray(logits)[counts])
        result = {
            "loss": sum(losses) / sum(totals),
            "average_precision": average_precision(np.concatenate(labels), np.concatenate(scores)),
        }
        if self.solutions:
            k_max = self.examples.actions.shape[1]
            sequences = greedy_sequences(weights, self.table, list(self.solutions), k_max)
            result["top1"] = float(np.mean(self._are_feasible(list(zip(self.solutions, sequences, strict=True)))))
        return result

    def _are_feasible(self, taken: Sequence[tuple[int, tuple[int, ...]]]) -> list[bool]:
        """Verdicts on sequences of scenes, by the labels or else by the judge; none is asked for twice."""
        known = [sequence in self.solutions[scene] for scene, sequence in taken]
        if self.judge is not None:
            fresh = (task for task, feasible in zip(taken, known, strict=True) if not feasible and task[1])
            unknown = [task for task in fresh if task not in self.judged]
            tasks = []
            for scene, sequence in unknown:
                actions = self.table.groundings[scene].actions
                tasks.append((self.examples.scenes[scene], tuple(actions[index] for index in sequence)))
            self.judged.update(zip(unknown, self.judge(tasks) if tasks else [], strict=True))
        return [feasible or self.judged.get(task, False) for task, feasible in zip(taken, known, strict=True)]


def _spread(rows: NDArray[np.integer], most: int) -> NDArray[np.integer]:
    """At most so many rows, evenly spread."""
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(int)]
