"""The curve in joint space through the slices of a path."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator


def joint_curve(home: Float[np.ndarray, " joints"], q: Float[np.ndarray, "slices joints"]) -> PchipInterpolator:
    """The motion's joint angles over the slices 0 (home) to T, from those at the slices 1 to T.

    A monotone cubic keeps within the joint limits, and an arm that rests between two slices at rest. The arms have been at
    home before, so that they start from rest.

    Args:
        home: Joint angles at the start [rad].
        q: Joint angles at the slices [rad].
    """
    times = np.arange(-1, len(q) + 1)
    return PchipInterpolator(times, np.concatenate([home[None], home[None], q]), axis=0)
