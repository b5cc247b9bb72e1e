"""How programs are compiled, and how they are kept on disk, so that only the first run on a machine waits for it."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import shutil
from collections import defaultdict
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from threading import Lock
from typing import Any, Generic, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import serialize_executable

from dvr_jax.runtime.files import write_whole

CPU_OPTIONS: dict[str, Any] = {
    "xla_cpu_multi_thread_eigen": False,
    "xla_cpu_use_fusion_emitters": False,
    "xla_disable_hlo_passes": "cse_barrier_expander",
}
"""For programs of many small kernels. Handing a kernel of a few microseconds to another thread costs more than it
saves (an iteration of 60 slices: 5.0 ms with, 2.9 ms without); the older of XLA's two code generators compiles twice as
fast (`measure`: 5.2 s and 2.8 s) to code of the same speed; and barriers must stay until fusion is done, for
`dvr_jax.geometry.vectors.materialize` to work (forward kinematics of 60 slices: 0.62 ms without, 0.18 ms with)."""

SWITCH = "DVR_JAX_CACHE"
"""Environment variable: a folder for compiled programs in place of the default one, or "off"."""

KEPT = 8
"""Folders of executables that are kept, each of one state of the sources and the machine; the oldest ones go."""

DEPENDENCIES = ("jax", "jaxlib", "flax", "mujoco", "numpy")
"""Packages whose versions an executable depends on."""

_SHAPE_AND_TYPE = attrgetter("shape", "dtype")

_P = ParamSpec("_P")
_R = TypeVar("_R")


def cache_folder() -> Path | None:
    """Where compiled programs are kept: `$DVR_JAX_CACHE`, else `$XDG_CACHE_HOME/dvr_jax` or `~/.cache/dvr_jax`; None:
    nowhere."""
    chosen = os.environ.get(SWITCH)
    if chosen:
        return None if chosen == "off" else Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dvr_jax"


class Program(Generic[_P, _R]):
    """A function that is compiled once for all shapes of its arguments, on this machine and for good.

    JAX's own persistent cache still traces and lowers a function before it can look it up, which takes longer here
    than all the rest of a plan; this one keeps executables under the shapes and the package's sources. Only functions
    of this package's modules are kept: nothing else tells one lambda or closure, or another program's, from the next.
    Called under another transformation it is the plain function."""

    def __init__(self, function: Callable[_P, _R]) -> None:
        """A program of a function of positional arguments only, all of them trees of arrays."""
        self.__doc__ = function.__doc__
        self._function = function
        self._compiled: dict[object, Callable[..., _R]] = {}
        self._locks: defaultdict[object, Lock] = defaultdict(Lock)

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Run it, compiled or loaded before if need be; there are no keyword arguments."""
        assert not kwargs
        leaves, tree = jax.tree.flatten(args)
        if any(issubclass(kind, jax.core.Tracer) for kind in set(map(type, leaves))):
            return self._function(*args)  # type: ignore[call-arg]
        key = (jax.config.values["jax_enable_x64"], tree, *map(_SHAPE_AND_TYPE, leaves))
        compiled = self._compiled.get(key)
        if compiled is None:
            # Another thread may be compiling the same.
            with self._locks[key]:
                compiled = self._compiled.get(key)
                if compiled is None:
                    compiled = self._compiled[key] = self._load_or_compile(key, args)
        return compiled(*args)

    def _compile(self, args: tuple[Any, ...]) -> jax.stages.Compiled:
        options = CPU_OPTIONS if jax.default_backend() == "cpu" else {}
        return jax.jit(self._function, compiler_options=options).lower(*args).compile()

    def _load_or_compile(self, key: tuple[Any, ...], args: tuple[Any, ...]) -> Callable[..., _R]:
        cache, name = cache_folder(), f"{self._function.__module__}.{self._function.__qualname__}"
        if cache is None or not name.startswith("dvr_jax.") or "<" in name:
            return self._compile(args)
        digest = hashlib.sha256(repr((name, key)).encode()).hexdigest()
        path = cache / _surroundings() / f"{name}-{digest[:32]}.executable"
        _register_linear_algebra()
        try:
            program, inputs, outputs = pickle.loads(path.read_bytes())
            device = jax.devices()[:1]
            return serialize_executable.deserialize_and_load(program, inputs, outputs, execution_devices=device)
        except Exception:
            pass  # Absent, cut short, or of another jaxlib: whatever it is, it is of no use.
        compiled = self._compile(args)
        # What JAX's own cache gives back cannot be serialised again: the copy lacks its functions. Sources that were
        # edited since this process read them are not those of the executable.
        if jax.config.values["jax_compilation_cache_dir"] is None and _hash_sources() == _SOURCES:
            _write(path, pickle.dumps(serialize_executable.serialize(compiled)))
        return compiled


def _write(path: Path, content: bytes) -> None:
    """Whole or not at all; a cache that cannot be written is none."""
    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True)
            _remove_oldest(path.parents[1])
        write_whole(path, content)
    except OSError:
        pass


def _remove_oldest(cache: Path) -> None:
    """Keep the folders that were written last."""
    folders = [path for path in cache.iterdir() if path.is_dir() and path.name.startswith(_PREFIX)]
    for folder in sorted(folders, key=lambda path: path.stat().st_mtime)[:-KEPT]:
        shutil.rmtree(folder, ignore_errors=True)


def _hash_sources() -> str:
    """Hash of the package's files that programs come of."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.xml")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_SOURCES = _hash_sources()
"""Taken now, with the package's modules just read, and not when the first program is called."""

_PREFIX = "programs-"


@lru_cache(maxsize=1)
def _register_linear_algebra() -> None:
    """Make XLA know LAPACK's routines, which JAX does when it first lowers one; a loaded executable that calls one
    before that ends the process."""

    def routines(A: jax.Array) -> jax.Array:
        return jax.lax.linalg.triangular_solve(jnp.linalg.cholesky(A), A, left_side=True, lower=True)

    jax.jit(routines).lower(np.eye(1))


@lru_cache(maxsize=1)
def _surroundings() -> str:
    """Name of the folder of what an executable depends on besides its function: sources, libraries, devices."""
    processor = Path("/proc/cpuinfo")
    flags = (
        next((line for line in processor.read_text().splitlines() if line.startswith(("flags", "Features"))), "")
        if processor.exists()
        else platform.processor()
    )
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    versions = [version(name) for name in DEPENDENCIES]
    settings = os.environ.get("XLA_FLAGS", "")
    everything = repr((_SOURCES, versions, devices, settings, platform.machine(), flags))
    return _PREFIX + hashlib.sha256(everything.encode()).hexdigest()[:16]
