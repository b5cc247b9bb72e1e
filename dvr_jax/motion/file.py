"""Files of motions: .npz archives with the arrays `time`, `qpos` and `switch` of a `Motion`."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dvr_jax.errors import MotionError, describe_os_error
from dvr_jax.motion.motion import Motion, make_motion, validate_motion

ARRAYS = ("time", "qpos", "switch")
"""Names of the arrays in a file, in the order of the fields of `Motion`."""


def save_motion(path: str | Path, motion: Motion) -> None:
    """Write a motion as a compressed archive.

    Args:
        path: Name of the file; no suffix is added.
        motion: The motion.

    Raises:
        MotionError: The motion is not valid; nothing is written.
        OSError: The file cannot be written.
    """
    validate_motion(motion)

    # NumPy appends ".npz" to a name, but not to an open file.
    with Path(path).open("wb") as file:
        np.savez_compressed(file, time=motion.time, qpos=motion.qpos, switch=motion.switch)


def load_motion(path: str | Path) -> Motion:
    """Read the motion that `save_motion` wrote.

    Raises:
        MotionError: The file is missing, is broken, or holds no valid motion.
    """
    try:
        with Path(path).open("rb") as file:
            arrays = _read_arrays(file, path)
    except OSError as error:
        # NumPy's reader does not name the file when it seeks beyond the end of a broken one.
        error.filename = str(path)
        raise MotionError(describe_os_error(error)) from None
    except (
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        RuntimeError,
    ) as error:
        reason = " ".join(str(error).split()).rstrip(".") or "it ends too early"
        raise MotionError(f"{path} holds no motion: {reason}.") from None

    try:
        return make_motion(*arrays)
    except MotionError as error:
        raise MotionError(f"{path}: {error}") from None


def _read_arrays(file: BinaryIO, path: str | Path) -> list[np.ndarray]:
    """Read the arrays of an open archive in the order of `ARRAYS`."""
    archive = np.load(file, allow_pickle=False)
    if not isinstance(archive, np.lib.npyio.NpzFile):
        raise MotionError(
            f"{path} is no .npz archive; valid is one with the arrays {', '.join(ARRAYS)}."
        )

    missing = [name for name in ARRAYS if name not in archive]
    if missing:
        raise MotionError(
            f"{path} lacks {', '.join(missing)}; a motion has the arrays {', '.join(ARRAYS)}."
        )
    return [archive[name] for name in ARRAYS]
