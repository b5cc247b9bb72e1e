"""How programs are compiled, and how they are kept on disk, so that only the first run on a machine waits for it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import jax

COMPILER_OPTIONS: dict[str, Any] = {"xla_cpu_multi_thread_eigen": False, "xla_cpu_use_fusion_emitters": False}
"""For `jax.jit` of programs of many small kernels; of no effect but on CPUs. Handing a kernel of a few microseconds to
another thread costs more than it saves (an iteration of 60 slices: 5.0 ms with, 2.9 ms without), and the older of
XLA's two code generators compiles twice as fast (`measure`: 5.2 s and 2.8 s) to code of the same speed."""


def keep_compiled_programs() -> None:
    """Turn on JAX's persistent compilation cache, unless the user has set one: `$XDG_CACHE_HOME/dvr_jax` or
    `~/.cache/dvr_jax`."""
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dvr_jax"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
