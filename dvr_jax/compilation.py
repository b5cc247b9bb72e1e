"""Keep compiled programs on disk, so that only the first run of a command on a machine waits for the compiler."""

from __future__ import annotations

import os
from pathlib import Path

import jax


def keep_compiled_programs() -> None:
    """Turn on JAX's persistent compilation cache, unless the user has set one: `$XDG_CACHE_HOME/dvr_jax` or
    `~/.cache/dvr_jax`."""
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dvr_jax"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
