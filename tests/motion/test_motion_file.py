"""Motions as files: they come back unchanged, and broken ones are refused in one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvr_jax.errors import MotionError
from dvr_jax.motion import Motion, load_motion, make_motion, save_motion

TIME = np.arange(5) * 0.02
QPOS = np.arange(125.0).reshape(5, 25)


def test_comes_back_unchanged(tmp_path: Path) -> None:
    motion = make_motion(TIME, QPOS, [2, 4])
    save_motion(tmp_path / "trajectory", motion)  # exactly this name, no suffix added
    again = load_motion(tmp_path / "trajectory")
    for name in ("time", "qpos", "switch"):
        kept, loaded = getattr(motion, name), getattr(again, name)
        assert np.array_equal(kept, loaded) and kept.dtype == loaded.dtype
    assert again.step == pytest.approx(0.02)


def test_single_precision_time_is_uniform_enough() -> None:
    time = (np.arange(1000) * 0.02).astype(np.float32)
    assert make_motion(time, np.zeros((1000, 25)), []).time.dtype == np.float64


@pytest.mark.parametrize(
    ("time", "qpos", "switch", "message"),
    [
        (TIME[:, None], QPOS, [1], "time has shape"),
        (TIME, QPOS[0], [1], "qpos has shape"),
        (TIME, QPOS, [[1]], "switch has shape"),
        (TIME[:1], QPOS[:1], [], "1 samples; valid are at least 2"),
        (TIME, QPOS[:4], [1], "5 times, but 4 states"),
        (TIME, np.where(QPOS == 60, np.nan, QPOS), [1], "qpos is not finite at sample 2"),
        (np.where(TIME > 0.07, np.inf, TIME), QPOS, [1], "time is not finite at sample 4"),
        (TIME[::-1], QPOS, [1], "time does not increase after sample"),
        (TIME**2, QPOS, [1], "one step throughout"),
        (TIME, QPOS, [0], "increasing numbers from 1 to 4"),
        (TIME, QPOS, [5], "increasing numbers from 1 to 4"),
        (TIME, QPOS, [3, 3], "increasing numbers from 1 to 4"),
        (TIME, QPOS, [1.5], "valid are integers"),
        (TIME, [*QPOS.astype(str).tolist(), ["x"]], [1], "does not hold numbers"),
        (["a"], QPOS, [1], "does not hold numbers"),
    ],
)
def test_broken_arrays_are_refused(time: Any, qpos: Any, switch: Any, message: str) -> None:
    with pytest.raises(MotionError, match=message):
        make_motion(time, qpos, switch)


def test_a_broken_motion_is_not_saved(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match="increasing"):
        save_motion(tmp_path / "motion.npz", Motion(TIME, QPOS, np.array([9])))
    assert not (tmp_path / "motion.npz").exists()


def test_broken_files_are_refused(tmp_path: Path) -> None:
    good = tmp_path / "good.npz"
    save_motion(good, make_motion(TIME, QPOS, [1]))
    with pytest.raises(MotionError, match="No such file"):
        load_motion(tmp_path / "none.npz")
    with pytest.raises(MotionError, match="Is a directory"):
        load_motion(tmp_path)
    for content in (
        b"",
        b"hello",
        good.read_bytes()[:200],
        good.read_bytes()[:-40],
        _flipped(good.read_bytes()),
    ):
        (tmp_path / "bad.npz").write_bytes(content)
        with pytest.raises(MotionError, match=r"bad\.npz") as caught:
            load_motion(tmp_path / "bad.npz")
        assert "\n" not in str(caught.value)
    np.save(tmp_path / "array.npy", TIME)
    with pytest.raises(MotionError, match=r"is no \.npz archive"):
        load_motion(tmp_path / "array.npy")
    np.savez(tmp_path / "part.npz", time=TIME)
    with pytest.raises(MotionError, match="lacks qpos, switch"):
        load_motion(tmp_path / "part.npz")
    np.savez(tmp_path / "objects.npz", time=TIME, qpos=np.array([{}], dtype=object), switch=[1])
    with pytest.raises(MotionError, match=r"objects\.npz"):
        load_motion(tmp_path / "objects.npz")
    np.savez(tmp_path / "short.npz", time=TIME, qpos=QPOS[:3], switch=[1])
    with pytest.raises(MotionError, match=r"short\.npz: the motion has 5 times, but 3 states"):
        load_motion(tmp_path / "short.npz")


def _flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return (
        content[:middle]
        + bytes(byte ^ 0xFF for byte in content[middle : middle + 30])
        + content[middle + 30 :]
    )
