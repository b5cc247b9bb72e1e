"""Files of motions: .npz archives with the arrays `time`, `qpos` and `switch` of a `Motion`."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from dvr_jax.errors import MotionError, describe_os_error
from dvr_jax.motion.motion import Motion, make_motion, validate_motion
from dvr_jax.runtime.archives import read_arrays
from dvr_jax.runtime.files import write_whole

ARRAYS = ("time", "qpos", "switch")
"""Names of the arrays in a file, in the order of the fields of `Motion`."""

LARGEST_MOTION = 1 << 30
"""Bytes of the largest motion that is read; a minute of two arms and eight objects has about 2 MB."""


def encode_motion(motion: Motion) -> bytes:
    """Return the content of a motion's file, a compressed archive.

    Raises:
        MotionError: The motion is not valid.
    """
    validate_motion(motion)

    content = io.BytesIO()
    np.savez_compressed(content, time=motion.time, qpos=motion.qpos, switch=motion.switch)
    return content.getvalue()


def save_motion(path: str | Path, motion: Motion) -> None:
    """Write a motion as a compressed archive, whole or not at all.

    Args:
        path: Name of the file; no suffix is added.
        motion: The motion.

    Raises:
        MotionError: The motion is not valid; nothing is written.
        OSError: The file cannot be written.
    """
    write_whole(Path(path), encode_motion(motion))


def load_motion(path: str | Path) -> Motion:
    """Read the motion that `save_motion` wrote.

    Raises:
        MotionError: The file is missing, is broken, or holds no valid motion.
    """
    try:
        arrays = read_arrays(Path(path), LARGEST_MOTION)
    except OSError as error:
        raise MotionError(describe_os_error(error)) from None
    except ValueError as error:
        raise MotionError(f"{path} holds no motion: {error}.") from None

    missing = [name for name in ARRAYS if name not in arrays]
    if missing:
        raise MotionError(
            f"{path} lacks {', '.join(missing)}; a motion has the arrays {', '.join(ARRAYS)}."
        )

    try:
        return make_motion(*(arrays[name] for name in ARRAYS))
    except MotionError as error:
        raise MotionError(f"{path}: {error}") from None
