"""JAX as all tests use it: float64, compiled programs kept between runs, and shapes checked.

Set before any test module is imported, hence before JAX builds anything and before any module of the package is read.
"""

import os
import tempfile
from pathlib import Path

import jax
from jaxtyping import install_import_hook

# The shapes and types in the annotations of these packages are checked whenever one of their functions is called. Of
# `dvr_jax.scene` only what works on arrays: the rest is there to refuse wrong values, which tests hand to it. Absent is
# `dvr_jax.workcell.model`, whose dataclass is a pytree: JAX also makes ones whose leaves are no arrays.
install_import_hook(
    [
        "dvr_jax.geometry",
        "dvr_jax.modes",
        "dvr_jax.motion",
        "dvr_jax.nlp",
        "dvr_jax.operators",
        "dvr_jax.scene.camera",
        "dvr_jax.scene.layout",
        "dvr_jax.scene.mjcf",
        "dvr_jax.scene.pinhole",
        "dvr_jax.seeds",
        "dvr_jax.shapes",
        "dvr_jax.solver",
        "dvr_jax.workcell.gripper_motion",
        "dvr_jax.workcell.kinematics",
        "dvr_jax.workcell.panda",
        "dvr_jax.workcell.robot",
        "dvr_jax.workcell.workcell",
    ],
    "annotation_checks.check",
)

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_platforms", "cpu")
# Implicit rank promotion is allowed: the library broadcasts per-pair constants and single weights against batches.
jax.config.update("jax_numpy_rank_promotion", "allow")
os.environ.setdefault(
    "DVR_JAX_CACHE", str(Path(tempfile.gettempdir()) / f"dvr_jax_tests_{os.getuid()}")
)
