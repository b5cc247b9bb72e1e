"""A motion of a whole scene, sampled in time."""
