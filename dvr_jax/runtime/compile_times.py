"""How long each program took to compile in this process, for those who want to shorten a machine's first plan."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax


@dataclass(frozen=True, slots=True)
class CompileTimes:
    """One program that was compiled; all times are elapsed times, also where threads share the cores."""

    name: str
    """Module and name of the function, without the package."""

    shapes: tuple[tuple[int, ...], ...]
    """Shapes of its arguments that have axes."""

    begin: float
    """When its compilation began, by `time.monotonic` [s]."""

    tracing: float
    """Time in which JAX ran the function to record its operations [s]."""

    lowering: float
    """Time in which JAX translated them for XLA [s]."""

    compiling: float
    """Time in which XLA made machine code of them [s]."""


_times: list[CompileTimes] = []


def compile_program(
    function: Callable[..., Any], args: tuple[Any, ...], options: dict[str, Any]
) -> jax.stages.Compiled:
    """Compile a function for arguments of these shapes, and note how long it took.

    Args:
        function: Function of the arguments.
        args: Trees of arrays, or of what `jax.eval_shape` returns.
        options: Options of XLA.
    """
    begin = time.monotonic()
    traced = jax.jit(function, compiler_options=options).trace(*args)
    after_tracing = time.monotonic()
    lowered = traced.lower()
    after_lowering = time.monotonic()
    compiled = lowered.compile()

    name = f"{function.__module__.removeprefix('dvr_jax.')}.{function.__qualname__}"
    shapes = tuple(leaf.shape for leaf in jax.tree.leaves(args) if getattr(leaf, "shape", ()))
    _times.append(
        CompileTimes(
            name=name,
            shapes=shapes,
            begin=begin,
            tracing=after_tracing - begin,
            lowering=after_lowering - after_tracing,
            compiling=time.monotonic() - after_lowering,
        )
    )
    return compiled


def compile_times() -> list[CompileTimes]:
    """Return the programs that this process has compiled, in the order in which they were ready."""
    return list(_times)
