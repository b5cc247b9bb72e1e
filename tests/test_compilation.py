"""Programs kept on disk: found again by another process, compiled anew when broken, absent when switched off."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CODE = """
import sys
import numpy as np
import jax
import jax.numpy as jnp
from dvr_jax.compilation import Program

traced = []

def factor(A):
    "Cholesky factor."
    traced.append(A)
    return jnp.linalg.cholesky(A @ A.T + jnp.eye(3, dtype=A.dtype))

program = Program(factor)
A = np.arange(9, dtype=np.float32).reshape(3, 3)
np.save(sys.argv[1], np.asarray(program(A)))
np.asarray(program(A))
print(len(traced))
"""


def run(folder: Path | str, out: Path) -> tuple[int, np.ndarray]:
    """Number of times that the function was traced in a process of its own, and the result."""
    environment = {"DVR_JAX_CACHE": str(folder), "JAX_PLATFORMS": "cpu", "PATH": ""}
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(out)], env=environment, capture_output=True, text=True, check=True
    )
    return int(done.stdout), np.load(out)


@pytest.fixture
def expected() -> np.ndarray:
    A = np.arange(9.0).reshape(3, 3)
    return np.linalg.cholesky(A @ A.T + np.eye(3))


def test_a_second_process_need_not_trace(tmp_path: Path, expected: np.ndarray) -> None:
    folder = tmp_path / "cache"
    for traces in (1, 0):
        traced, result = run(folder, tmp_path / "out.npy")
        assert traced == traces
        np.testing.assert_allclose(result, expected, rtol=1e-4)
    assert len(list(folder.iterdir())) == 1


def test_a_broken_file_is_compiled_anew(tmp_path: Path, expected: np.ndarray) -> None:
    folder = tmp_path / "cache"
    run(folder, tmp_path / "out.npy")
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    traced, result = run(folder, tmp_path / "out.npy")
    assert traced == 1
    np.testing.assert_allclose(result, expected, rtol=1e-4)
    assert run(folder, tmp_path / "out.npy")[0] == 0


def test_switched_off_it_writes_nothing(tmp_path: Path) -> None:
    assert run("off", tmp_path / "out.npy")[0] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file", tmp_path / "out.npy")[0] == 1
