"""A motion of a whole scene, sampled in time: its record, its file, and the curve through a path's slices."""

from dvr_jax.motion.file import load_motion, save_motion
from dvr_jax.motion.motion import Motion, make_motion, validate_motion

__all__ = ["Motion", "load_motion", "make_motion", "save_motion", "validate_motion"]
