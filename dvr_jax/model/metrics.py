"""Figures of merit of predictions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def average_precision(
    labels: Bool[np.ndarray, "*shape"],
    scores: Float[np.ndarray, "*shape"],
) -> float:
    """Compute the average precision of scores.

    It is the sum over all distinct thresholds n of (R_n - R_{n-1}) P_n, with recall R_n and precision P_n of the labels
    whose score is at least the threshold. Equal scores share a threshold, so their order does not matter.

    Args:
        labels: What is true.
        scores: Predictions, the larger the more likely true.

    Returns:
        The average precision, NaN if no label is true.
    """
    order = np.argsort(-scores.ravel(), kind="stable")
    sorted_scores = scores.ravel()[order]
    hits = np.cumsum(labels.ravel()[order])
    if not len(hits) or hits[-1] == 0:
        return float("nan")

    # A threshold takes in a whole run of equal scores, so it counts at the last of them.
    last_of_run = np.append(np.flatnonzero(np.diff(sorted_scores)), len(hits) - 1)
    gained_hits = np.diff(hits[last_of_run], prepend=0)
    precision_of_gain = gained_hits * hits[last_of_run] / (last_of_run + 1)
    return float(np.sum(precision_of_gain) / hits[-1])
