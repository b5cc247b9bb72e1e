"""A motion of a whole scene, sampled in time: what a planner hands over, what is checked, drawn and saved.

`qpos` is the full state of the scene's own MJCF, in the layout of `dvr_jax.scene.mjcf.qpos_layout`; a held object is a
free body that is carried rigidly. On disk a motion is an .npz archive with the arrays `time`, `qpos` and `switch`.
"""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError, describe_os_error

UNEVENNESS = 1e-4
"""Time steps may differ from their mean by this share of it: rounding, also of time stored in single precision."""

QUATERNION_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1."""

ARRAYS = ("time", "qpos", "switch")


@dataclass(frozen=True, slots=True)
class Motion:
    """T samples of a motion that carries out K actions."""

    time: NDArray[np.float64]
    """(T,) s, uniform, increasing."""
    qpos: NDArray[np.float64]
    """(T, nq) full state: arms and fingers (rad, m), then position and unit quaternion of each object."""
    switch: NDArray[np.int64]
    """(K,) sample at which action k takes effect: from it on the object is attached to the gripper, or released."""

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def make_motion(time: object, qpos: object, switch: object) -> Motion:
    """The valid motion of these arrays, converted to float64 and int64; DvrError when they are none."""
    motion = Motion(_as_floats("time", time), _as_floats("qpos", qpos), _as_integers("switch", switch))
    validate_motion(motion)
    return motion


def validate_motion(motion: Motion) -> None:
    """Raise a DvrError that names the first broken rule: shapes, finiteness, uniform time, increasing switches."""
    time, qpos, switch = motion.time, motion.qpos, motion.switch
    for name, array, axes in (("time", time, 1), ("qpos", qpos, 2), ("switch", switch, 1)):
        if array.ndim != axes:
            raise DvrError(f"the motion's {name} has shape {array.shape}; valid is an array with {axes} axes.")
    if len(time) < 2:
        raise DvrError(f"the motion has {len(time)} samples; valid are at least 2.")
    if len(qpos) != len(time):
        raise DvrError(f"the motion has {len(time)} times, but {len(qpos)} states; valid is one state for each time.")
    for name, array in (("time", time), ("qpos", qpos)):
        if not np.isfinite(array).all():
            where = int(np.argwhere(~np.isfinite(array))[0, 0])
            raise DvrError(f"the motion's {name} is not finite at sample {where}; valid are finite numbers.")
    steps = np.diff(time)
    if steps.min() <= 0:
        raise DvrError(f"the motion's time does not increase after sample {int(steps.argmin())}.")
    if np.abs(steps - motion.step).max() > UNEVENNESS * motion.step:
        raise DvrError(
            f"the motion's time steps are {steps.min():g} to {steps.max():g} s; valid is one step throughout."
        )
    if not np.issubdtype(switch.dtype, np.integer):
        raise DvrError(f"the motion's switch holds {switch.dtype} numbers; valid are integers.")
    bounded = np.concatenate([[0], switch, [len(time)]])
    if np.diff(bounded).min() <= 0:
        raise DvrError(
            f"the motion's switches are at the samples {switch.tolist()}; "
            f"valid are increasing numbers from 1 to {len(time) - 1}."
        )


def save_motion(path: str | Path, motion: Motion) -> None:
    """Write a valid motion as a compressed .npz archive under exactly this name."""
    validate_motion(motion)
    with Path(path).open("wb") as file:  # given a name, NumPy would append ".npz" to it
        np.savez_compressed(file, time=motion.time, qpos=motion.qpos, switch=motion.switch)


def load_motion(path: str | Path) -> Motion:
    """The motion that `save_motion` wrote; DvrError for a file that is missing, broken or holds no valid motion."""
    try:
        with Path(path).open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise DvrError(f"{path} is no .npz archive; valid is one with the arrays {', '.join(ARRAYS)}.")
            missing = [name for name in ARRAYS if name not in archive]
            if missing:
                raise DvrError(f"{path} lacks {', '.join(missing)}; a motion has the arrays {', '.join(ARRAYS)}.")
            arrays = [archive[name] for name in ARRAYS]
    except OSError as error:
        error.filename = str(path)  # missing where the archive's reader seeks beyond a broken file's end
        raise DvrError(describe_os_error(error)) from None
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".") or "it ends too early"
        raise DvrError(f"{path} holds no motion: {reason}.") from None
    try:
        return make_motion(*arrays)
    except DvrError as error:
        raise DvrError(f"{path}: {error}") from None


def _as_floats(name: str, values: object) -> NDArray[np.float64]:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise DvrError(f"the motion's {name} does not hold numbers; valid are real numbers.") from None


def _as_integers(name: str, values: object) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise DvrError(f"the motion's {name} holds {array.dtype} numbers; valid are integers.")
    return array.astype(np.int64)
