"""The curve of joint angles through the slices of a path, which a motion follows between them.

The curve is the monotone piecewise cubic interpolant of Fritsch and Butland, "A method for constructing local monotone
piecewise cubic interpolants" (SIAM Journal on Scientific and Statistical Computing 5, 1984). Between two slices each
joint angle stays between its values at the two slices. Hence the curve keeps within the joint limits, and an arm that
has the same posture at two slices rests between them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator


def joint_curve(
    home: Float[np.ndarray, " joints"], q: Float[np.ndarray, "slices joints"]
) -> PchipInterpolator:
    """Interpolate the joint angles of a path over its slices.

    Args:
        home: Joint angles of all arms at slice 0 [rad].
        q: Joint angles at the slices 1 to T [rad].

    Returns:
        A function from slice numbers in [0, T], which need not be whole, to joint angles [rad].
    """
    # One more slice at home before slice 0 makes the arms start from rest.
    slices = np.arange(-1, len(q) + 1)
    angles = np.concatenate([home[None], home[None], q])
    return PchipInterpolator(slices, angles, axis=0)
