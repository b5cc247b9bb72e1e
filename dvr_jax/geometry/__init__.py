"""Geometry: vectors and angles, signed distances of capsules and prisms, and footprints in the plane.

All is written in JAX except the footprints, which are NumPy. Start reading at `vectors`, then `wrenches` and `prisms`.
"""
