"""JAX as all tests use it: float64, and compiled programs kept between runs.

Set before any test module is imported, hence before JAX builds anything.
"""

import os
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_platforms", "cpu")
# Implicit rank promotion is allowed: the library broadcasts per-pair constants and single weights against batches.
jax.config.update("jax_numpy_rank_promotion", "allow")
os.environ.setdefault("DVR_JAX_CACHE", str(Path(tempfile.gettempdir()) / f"dvr_jax_tests_{os.getuid()}"))
