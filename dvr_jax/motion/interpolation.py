"""What a motion does between its samples.

Joint angles, finger travels and object positions follow the cubic spline through the samples that is at rest at both
ends. Its acceleration is continuous and its jerk is bounded. So do the four numbers of a quaternion, whose length
deviates from 1 by less than a millionth at the rate of planned motions; who needs a unit quaternion normalizes it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline

from dvr_jax.errors import OptionError
from dvr_jax.motion.motion import Motion, make_motion

RATE_RANGE = (1.0, 10_000.0)
"""Least and largest rate at which a motion can be sampled [1/s]."""


def spline_of(motion: Motion) -> CubicSpline:
    """Return the spline through all numbers of a motion's states, as a function of the time since its start [s]."""
    return CubicSpline(motion.time - motion.time[0], motion.qpos, bc_type="clamped")


def sample_motion(motion: Motion, rate: float) -> Motion:
    """Return a motion with samples at another rate.

    Args:
        motion: The motion.
        rate: Number of samples in each second [1/s].

    Returns:
        The motion from its start to its end, or up to one step longer, at rest there. An action takes effect at the
        first sample that is not earlier than in the given motion.

    Raises:
        OptionError: The rate is no number from 1 to 10,000.
    """
    least, most = RATE_RANGE
    if not (math.isfinite(rate) and least <= rate <= most):
        raise OptionError(f"the rate is {rate:g} samples a second; valid is {least:g} to {most:g}.")

    duration = float(motion.time[-1] - motion.time[0])
    time = np.arange(math.ceil(duration * rate - 1e-9) + 1) / rate
    qpos = spline_of(motion)(np.minimum(time, duration))

    switch_times = motion.time[motion.switch] - motion.time[0]
    switch = np.ceil(switch_times * rate - 1e-9).astype(int)
    return make_motion(motion.time[0] + time, qpos, switch)
