"""The type of arrays: JAX's under transformations and in compiled programs, NumPy's on the host."""

from __future__ import annotations

import jax
import numpy as np

Array = jax.Array | np.ndarray
"""An array of either kind. Pytrees hold NumPy arrays on the host and JAX arrays inside of compiled programs."""
