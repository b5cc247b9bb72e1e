"""Compiled programs: how they are compiled, and how they are found again, so that only a machine's first run waits."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from threading import Lock, get_ident
from typing import Any, Generic, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import serialize_executable

from dvr_jax.runtime.compile_times import compile_program
from dvr_jax.runtime.file_lock import only_process
from dvr_jax.runtime.load_ahead import load_in_background, take_loaded
from dvr_jax.runtime.program_files import (
    PREFIX,
    cache_folder,
    make_folder,
    read_entry,
    write_entry,
)

CPU_OPTIONS: dict[str, Any] = {
    "xla_cpu_multi_thread_eigen": False,
    "xla_cpu_use_fusion_emitters": False,
    "xla_disable_hlo_passes": "cse_barrier_expander",
}
"""Options of XLA for programs of many small kernels.

Handing a kernel of a few microseconds to another thread costs more than it saves: an iteration of 60 slices takes
5.0 ms with it and 2.9 ms without. The older of XLA's two code generators compiles twice as fast (`measure`: 2.8 s
instead of 5.2 s) to code of the same speed. Barriers must stay until fusion is done, or
`dvr_jax.geometry.vectors.materialize` has no effect: forward kinematics of 60 slices takes 0.62 ms without the
barriers and 0.18 ms with them.
"""

DEPENDENCIES = ("jax", "jaxlib", "flax", "mujoco", "numpy")
"""Packages whose versions an executable depends on."""

_SHAPE_AND_TYPE = attrgetter("shape", "dtype")

_P = ParamSpec("_P")
_R = TypeVar("_R")


class Program(Generic[_P, _R]):
    """A function that is compiled once for each set of argument shapes, and whose executables are kept on disk.

    JAX's own persistent cache still traces and lowers a function before it can look it up, which takes longer here
    than all the rest of a plan. This cache finds an executable by the function's name, the shapes of its arguments and
    the sources of the package. Only functions of this package's modules are kept, because nothing else tells one
    lambda or closure, or a function of another program, from the next one.

    Called under another transformation of JAX, a program is the plain function.
    """

    def __init__(self, function: Callable[_P, _R]) -> None:
        """Wrap a function that takes positional arguments only, all of them trees of arrays."""
        self.__doc__ = function.__doc__
        self._function = function
        self._compiled: dict[object, Callable[..., _R]] = {}
        self._locks: defaultdict[object, Lock] = defaultdict(Lock)

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Run the program; the first call with these shapes loads or compiles it.

        Args:
            args: Trees of arrays.
            kwargs: None; a program takes positional arguments only.

        Returns:
            What the function returns.
        """
        assert not kwargs
        leaves, tree = jax.tree.flatten(args)

        if any(issubclass(kind, jax.core.Tracer) for kind in set(map(type, leaves))):
            return self._function(*args)  # type: ignore[call-arg]

        key = (jax.config.read("jax_enable_x64"), tree, *map(_SHAPE_AND_TYPE, leaves))
        compiled = self._compiled.get(key)
        if compiled is None:
            compiled = self._get_ready(key, args)

        return compiled(*args)

    def prepare(self, *args: Any) -> None:
        """Load or compile the program for arguments of these shapes, without running it.

        Args:
            args: Trees of arrays, or of what `jax.eval_shape` returns.
        """
        leaves, tree = jax.tree.flatten(args)
        key = (jax.config.read("jax_enable_x64"), tree, *map(_SHAPE_AND_TYPE, leaves))
        if key not in self._compiled:
            self._get_ready(key, args)

    def shapes_of_result(self, *args: Any) -> Any:
        """Return the shapes and types of what the program returns, for `prepare`.

        Args:
            args: Trees of arrays.
        """
        return jax.eval_shape(self._function, *args)

    def _get_ready(self, key: tuple[Any, ...], args: tuple[Any, ...]) -> Callable[..., _R]:
        """Return the executable of a key, which another thread may be compiling at the same time."""
        with _noted_as_waiting(self._function.__qualname__), self._locks[key]:
            compiled = self._compiled.get(key)
            if compiled is None:
                compiled = self._load_or_compile(key, args)
                self._compiled[key] = compiled

        return compiled

    def _compile(self, args: tuple[Any, ...]) -> jax.stages.Compiled:
        """Compile the function for arguments of these shapes."""
        options = CPU_OPTIONS if jax.default_backend() == "cpu" else {}
        for observer in list(_observers):
            observer()

        _compiling.append(self._function.__qualname__)
        try:
            return compile_program(self._function, args, options)
        finally:
            _compiling.remove(self._function.__qualname__)

    def _load_or_compile(self, key: tuple[Any, ...], args: tuple[Any, ...]) -> Callable[..., _R]:
        """Return the executable from the disk, or compile it and keep it there."""
        path = self._executable_path(key)
        if path is None:
            return self._compile(args)

        loaded = take_loaded(path) or _load_executable(path)
        _used.append(path.name)
        if loaded is not None:
            return loaded

        # Another process may be compiling the same program. Then this one waits and loads what the other has written.
        make_folder(path.parent)
        with only_process(path.with_suffix(".lock")):
            return _load_executable(path) or self._compile_and_keep(path, args)

    def _compile_and_keep(self, path: Path, args: tuple[Any, ...]) -> Callable[..., _R]:
        """Compile the function and write the executable to the disk."""
        compiled = self._compile(args)
        # What JAX's own cache gives back cannot be serialized again, because the copy lacks its functions. And if the
        # sources were edited since this process read them, the executable is not the one of the edited sources.
        if jax.config.values["jax_compilation_cache_dir"] is None and _hash_sources() == _SOURCES:
            write_entry(path, pickle.dumps(serialize_executable.serialize(compiled)))

        return compiled

    def _executable_path(self, key: tuple[Any, ...]) -> Path | None:
        """Return the file for the executable of a key, or None if it is not kept."""
        cache = cache_folder()
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        text = repr((name, key))
        # "<" also stands in the key where static data holds a function of another program, such as the inverse
        # kinematics of a user's robot: its sources are unknown too.
        if cache is None or not name.startswith("dvr_jax.") or "<" in text:
            return None

        digest = hashlib.sha256(text.encode()).hexdigest()
        return cache / _environment_folder() / f"{name}-{digest[:32]}.executable"


_used: list[str] = []
"""Names of the files of the programs that this process has called, in the order of their first calls."""


def load_programs_of(purpose: str) -> None:
    """Begin to load the programs that the last run for the same purpose used, in another thread.

    Args:
        purpose: What the process is going to do, as a part of a file's name.
    """
    cache = cache_folder()
    if cache is None:
        return

    folder = cache / _environment_folder()
    content = read_entry(folder / f"{purpose}.txt")
    if content is not None:
        names = content.decode().split()
        load_in_background([folder / name for name in names], _load_executable)


def keep_programs_of(purpose: str) -> None:
    """Keep in mind which programs this process has used, for `load_programs_of`.

    Args:
        purpose: What the process has done, as a part of a file's name.
    """
    cache = cache_folder()
    if cache is not None and _used:
        content = "".join(f"{name}\n" for name in _used).encode()
        write_entry(cache / _environment_folder() / f"{purpose}.txt", content)


_waiting: dict[int, str] = {}
"""Names of the programs that threads wait for, while they are compiled or loaded, by thread."""

_compiling: list[str] = []
"""Names of the programs that are being compiled."""

_observers: list[Callable[[], None]] = []
"""Functions that are called when a program is about to be compiled."""


@contextmanager
def _noted_as_waiting(name: str) -> Iterator[None]:
    """Keep the name of the program that this thread waits for while the block runs."""
    _waiting[get_ident()] = name
    try:
        yield
    finally:
        del _waiting[get_ident()]


@contextmanager
def when_compiling(observer: Callable[[], None]) -> Iterator[None]:
    """Call a function each time that a program has to be compiled while the block runs.

    Args:
        observer: Function that is called by the thread that compiles, before it does so.
    """
    _observers.append(observer)
    try:
        yield
    finally:
        _observers.remove(observer)


def compiling_programs() -> list[str]:
    """Return the names of the programs that are being compiled, by all threads."""
    return list(_compiling)


def awaited_program(thread: int) -> str | None:
    """Return the name of the program that a thread waits for, to be compiled or loaded; None if it waits for none.

    Args:
        thread: Identifier of the thread, as `threading.get_ident` returns it.
    """
    return _waiting.get(thread)


def _identity(tree: Any) -> Any:
    """Return a pytree unchanged."""
    return tree


to_device: Callable[[Any], Any] = Program(_identity)
"""Convert a pytree of NumPy arrays to JAX arrays.

As a compiled program this takes a third of the time of `jax.device_put`. What is passed to many programs is worth
converting once: ten NumPy arrays among the arguments of a program cost more than a tenth of a millisecond at each call.
"""


def _load_executable(path: Path) -> Callable[..., Any] | None:
    """Return the executable of a file, or None if the file is absent or of no use."""
    content = read_entry(path)
    if content is None:
        return None

    _register_linear_algebra()
    try:
        program, inputs, outputs = pickle.loads(content)
        return serialize_executable.deserialize_and_load(
            program,
            inputs,
            outputs,
            execution_devices=jax.devices()[:1],
        )
    except Exception:
        # Written by another jaxlib: the program is compiled anew.
        return None


def _hash_sources() -> str:
    """Return a hash of the files of the package that programs are made of."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()

    for path in sorted([*package.rglob("*.py"), *package.rglob("*.xml")]):
        digest.update(path.read_bytes())

    return digest.hexdigest()


_SOURCES = _hash_sources()
"""Hash of the sources, taken when the package's modules have just been read and not when a program is first called."""


@lru_cache(maxsize=1)
def _register_linear_algebra() -> None:
    """Make XLA know LAPACK's routines.

    JAX registers them when it first lowers a program that uses one. An executable that is loaded and calls a routine
    before that ends the process.
    """

    def factor_and_solve(A: jax.Array) -> jax.Array:
        return jax.lax.linalg.triangular_solve(
            jnp.linalg.cholesky(A), A, left_side=True, lower=True
        )

    jax.jit(factor_and_solve).lower(np.eye(1))


@lru_cache(maxsize=1)
def _environment_folder() -> str:
    """Name the folder for all that executables depend on besides their functions: sources, libraries, devices."""
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    versions = [version(name) for name in DEPENDENCIES]
    settings = os.environ.get("XLA_FLAGS", "")

    environment = (_SOURCES, versions, devices, settings, platform.machine(), _processor_features())
    return PREFIX + hashlib.sha256(repr(environment).encode()).hexdigest()[:16]


def _processor_features() -> str:
    """Return the instruction sets of the processor, as far as the operating system tells."""
    description = Path("/proc/cpuinfo")
    if not description.exists():
        return platform.processor()

    for line in description.read_text().splitlines():
        if line.startswith(("flags", "Features")):
            return line

    return ""
