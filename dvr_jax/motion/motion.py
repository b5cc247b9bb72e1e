"""A motion of a whole scene, sampled in time: what a planner returns, and what is checked, drawn and saved.

The states of a motion are full states of the scene's own MuJoCo model, in the order of
`dvr_jax.scene.mjcf.qpos_layout`. An object that an arm holds is a free body that is carried rigidly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.errors import MotionError

UNEVENNESS = 1e-4
"""Largest deviation of a time step from the mean step, as a fraction of the mean step. Rounding causes it, also that of
times that were stored in single precision."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Samples of a motion that carries out K actions."""

    time: Float[np.ndarray, " samples"]
    """Times of the samples [s], increasing in equal steps."""

    qpos: Float[np.ndarray, "samples nq"]
    """Full states: joint angles [rad] and finger travels [m] of the arms, then position [m] and unit quaternion
    (w, x, y, z) of each object."""

    switch: Int[np.ndarray, " actions"]
    """Sample at which each action takes effect: from it on the object is attached to a gripper, or released."""

    @property
    def step(self) -> float:
        """Time between two samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def sample(self, rate: float) -> Motion:
        """Return the same motion at another rate (`dvr_jax.motion.interpolation` says what lies between samples).

        Args:
            rate: Number of samples in each second [1/s].

        Returns:
            The motion. It begins at the same time and ends at the same state, up to one step later.

        Raises:
            OptionError: The rate is no number from 1 to 10,000.
        """
        from dvr_jax.motion.interpolation import sample_motion

        return sample_motion(self, rate)


def make_motion(time: object, qpos: object, switch: object) -> Motion:
    """Convert arrays to a valid motion.

    Args:
        time: Times (samples,) [s].
        qpos: Full states (samples, nq).
        switch: Sample (actions,) at which each action takes effect.

    Returns:
        The motion, in double precision and 64-bit integers.

    Raises:
        MotionError: The arrays are no motion; the message names the first broken rule.
    """
    motion = Motion(
        _as_floats("time", time),
        _as_floats("qpos", qpos),
        _as_integers("switch", switch),
    )
    validate_motion(motion)
    return motion


def validate_motion(motion: Motion) -> None:
    """Raise a MotionError that names the first rule that a motion breaks."""
    _validate_shapes(motion)
    _validate_numbers(motion)
    _validate_time(motion)
    _validate_switches(motion)


def _validate_shapes(motion: Motion) -> None:
    for name, array, axes in (
        ("time", motion.time, 1),
        ("qpos", motion.qpos, 2),
        ("switch", motion.switch, 1),
    ):
        if array.ndim != axes:
            raise MotionError(
                f"the motion's {name} has shape {array.shape}; valid is an array with {axes} axes."
            )

    samples = len(motion.time)
    if samples < 2:
        raise MotionError(f"the motion has {samples} samples; valid are at least 2.")
    if len(motion.qpos) != samples:
        raise MotionError(
            f"the motion has {samples} times, but {len(motion.qpos)} states; valid is one state for each time."
        )


def _validate_numbers(motion: Motion) -> None:
    for name, array in (("time", motion.time), ("qpos", motion.qpos)):
        finite = np.isfinite(array)
        if not finite.all():
            sample = int(np.argwhere(~finite)[0, 0])
            raise MotionError(
                f"the motion's {name} is not finite at sample {sample}; valid are finite numbers."
            )


def _validate_time(motion: Motion) -> None:
    steps = np.diff(motion.time)
    if steps.min() <= 0:
        raise MotionError(
            f"the motion's time does not increase after sample {int(steps.argmin())}."
        )

    if np.abs(steps - motion.step).max() > UNEVENNESS * motion.step:
        raise MotionError(
            f"the motion's time steps are {steps.min():g} to {steps.max():g} s; valid is one step throughout."
        )


def _validate_switches(motion: Motion) -> None:
    switch = motion.switch
    if not np.issubdtype(switch.dtype, np.integer):
        raise MotionError(f"the motion's switch holds {switch.dtype} numbers; valid are integers.")

    samples = len(motion.time)
    bounded = np.concatenate([[0], switch, [samples]])
    if np.diff(bounded).min() <= 0:
        raise MotionError(
            f"the motion's switches are at the samples {switch.tolist()}; "
            f"valid are increasing numbers from 1 to {samples - 1}."
        )


def _as_floats(name: str, values: object) -> Float[np.ndarray, "*shape"]:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MotionError(
            f"the motion's {name} does not hold numbers; valid are real numbers."
        ) from None


def _as_integers(name: str, values: object) -> Int[np.ndarray, "*shape"]:
    array = np.asarray(values)
    # An empty list becomes an array of floats, which is no mistake of the caller.
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise MotionError(f"the motion's {name} holds {array.dtype} numbers; valid are integers.")
    return array.astype(np.int64)
