"""Programs kept on disk: found again by another process, compiled anew when broken or when anything that they depend on
is another, absent when switched off."""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import dvr_jax
from dvr_jax.runtime.compilation import Program
from dvr_jax.runtime.program_files import KEPT

CODE = """
import sys
import numpy as np
import jax
import jax.numpy as jnp
{before}
from dvr_jax.runtime.compilation import Program

traced = []

def factor(A):
    "Cholesky factor."
    traced.append(A)
    return jnp.linalg.cholesky(A @ A.T + jnp.eye(3, dtype=A.dtype))

factor.__module__ = "{module}"
program = Program(factor)
A = np.arange(9, dtype=np.float32).reshape(3, 3)
{between}
np.save(sys.argv[1], np.asarray(program(A)))
np.asarray(program(A))
print(len(traced))
"""

A = np.arange(9.0).reshape(3, 3)
EXPECTED = np.linalg.cholesky(A @ A.T + np.eye(3))


def run(
    folder: Path | str,
    out: Path,
    before: str = "",
    between: str = "",
    module: str = "dvr_jax.any",
    environment: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Number of times that the function was traced in a process of its own, whose result is right."""
    tested = Path(dvr_jax.__file__).parents[1]
    environment = {
        "DVR_JAX_CACHE": str(folder),
        "JAX_PLATFORMS": "cpu",
        "PATH": "",
        "PYTHONPATH": str(tested),
        **environment,
    }
    code = CODE.format(before=before, between=between, module=module)
    command = [
        sys.executable,
        "-c",
        code,
        str(out),
    ]  # which looks for modules where it runs, before PYTHONPATH
    done = subprocess.run(command, env=environment, cwd=out.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(np.load(out), EXPECTED, rtol=1e-4)
    return int(done.stdout)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A cache that has the program."""
    assert run(tmp_path / "cache", tmp_path / "out.npy") == 1
    return tmp_path / "cache"


def test_a_second_process_need_not_trace(kept: Path, tmp_path: Path) -> None:
    assert run(kept, tmp_path / "out.npy") == 0
    assert len(list(kept.glob("*/*"))) == 1


def test_a_broken_file_is_compiled_anew(kept: Path, tmp_path: Path) -> None:
    (path,) = kept.glob("*/*")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert [run(kept, tmp_path / "out.npy") for _ in range(2)] == [1, 0]


OTHERS: dict[str, dict[str, object]] = {
    "number of devices": {"environment": {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}},
    "precision": {"environment": {"JAX_ENABLE_X64": "1"}},
    "version of a library": {
        "before": "import importlib.metadata as m; old = m.version; m.version = lambda name: old(name) + 'x'"
    },
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_surrounding_has_a_program_of_its_own(
    kept: Path, tmp_path: Path, other: str
) -> None:
    assert [run(kept, tmp_path / "out.npy", **OTHERS[other]) for _ in range(2)] == [1, 0]  # type: ignore[arg-type]


def test_edited_sources_are_another_program_and_those_read_before_the_edit_are_not_kept_for_them(
    kept: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "dvr_jax"
    shutil.copytree(
        Path(dvr_jax.__file__).parent,
        copy,
        ignore=shutil.ignore_patterns("*.npz", "*.png", "__pycache__"),
    )
    environment = {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    assert run(kept, tmp_path / "out.npy", environment=environment) == 0
    edit = f"open({str(copy / 'errors.py')!r}, 'a').write('# edited')"
    assert run(tmp_path / "other", tmp_path / "out.npy", between=edit, environment=environment) == 1
    assert not list((tmp_path / "other").glob("*/*"))
    assert run(kept, tmp_path / "out.npy", environment=environment) == 1


def test_functions_of_other_programs_are_not_kept(tmp_path: Path) -> None:
    """Their sources are unknown: another one of the same name would be taken for it."""
    folder = tmp_path / "cache"
    assert [run(folder, tmp_path / "out.npy", module="__main__") for _ in range(2)] == [1, 1]
    assert not folder.exists()


HOLDER = """
from dataclasses import dataclass, field
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import InverseKinematics

@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Holder:
    array: object
    kinematics: InverseKinematics = field(metadata={"static": True})

jax.tree_util.Holder = Holder
Holder.__module__ = "jax.tree_util"

def factor_inside(holder):
    return factor(holder.array)

factor_inside.__module__ = "dvr_jax.any"
program = Program(factor_inside)
A = Holder(A, KINEMATICS)
"""


@pytest.mark.parametrize(
    ("kinematics", "traces"),
    [("PANDA.inverse_kinematics", [1, 0]), ("InverseKinematics(lambda *pose: pose, 1)", [1, 1])],
    ids=["the package's", "a user's"],
)
def test_programs_whose_static_data_holds_a_function_of_another_program_are_not_kept(
    kinematics: str, traces: list[int], tmp_path: Path
) -> None:
    """As the inverse kinematics of a robot that a user defines: its edited source would not be noticed."""
    between = HOLDER.replace("KINEMATICS", kinematics)
    assert [
        run(tmp_path / "cache", tmp_path / "out.npy", between=between) for _ in range(2)
    ] == traces
    assert (tmp_path / "cache").exists() == (traces[1] == 0)


def test_the_oldest_programs_go(kept: Path, tmp_path: Path) -> None:
    for number in range(KEPT + 3):
        (kept / f"programs-{number}").mkdir()
    run(
        kept,
        tmp_path / "out.npy",
        before="import importlib.metadata as m; m.version = lambda name: '0'",
    )
    assert len(list(kept.glob("programs-*"))) == KEPT


def test_switched_off_it_writes_nothing(tmp_path: Path) -> None:
    assert run("off", tmp_path / "out.npy") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file", tmp_path / "out.npy") == 1


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("HOME", "/proc/1"),
        ("HOME", ""),
        ("XDG_CACHE_HOME", "/proc/1"),
        ("DVR_JAX_CACHE", "/dev/null"),
    ],
)
def test_without_a_place_for_the_cache_programs_are_compiled(
    variable: str, value: str, tmp_path: Path
) -> None:
    environment = {"DVR_JAX_CACHE": "", variable: value}
    assert [run("", tmp_path / "out.npy", environment=environment) for _ in range(2)] == [1, 1]


def test_a_full_disk_is_no_error(tmp_path: Path) -> None:
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))"
    assert run(tmp_path / "cache", tmp_path / "out.npy", between=full) == 1
    assert list((tmp_path / "cache").glob("*/*")) == []


def test_a_folder_of_others_is_not_read(kept: Path, tmp_path: Path) -> None:
    kept.chmod(0o777)
    assert run(kept, tmp_path / "out.npy") == 1
    kept.chmod(0o755)
    assert run(kept, tmp_path / "out.npy") == 0


def test_a_changed_byte_is_compiled_anew(kept: Path, tmp_path: Path) -> None:
    (path,) = kept.glob("*/*")
    whole = path.read_bytes()
    path.write_bytes(whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:])
    assert [run(kept, tmp_path / "out.npy") for _ in range(2)] == [1, 0]


def test_two_processes_may_fill_one_cache(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        outs = [tmp_path / "first.npy", tmp_path / "second.npy"]
        assert all(traced <= 1 for traced in pool.map(lambda out: run(tmp_path / "c", out), outs))
    assert run(tmp_path / "c", tmp_path / "third.npy") == 0


def test_a_program_has_one_executable_for_each_precision() -> None:
    """Of the same arguments: 64-bit numbers that are not allowed become 32-bit ones."""
    program = Program(jnp.cumsum)
    for allowed, dtype in ((False, np.float32), (True, np.float64), (False, np.float32)):
        with jax.enable_x64(allowed):
            assert program(np.ones(3)).dtype == dtype
