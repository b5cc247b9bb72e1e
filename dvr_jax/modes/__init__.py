"""Kinematic modes: how an object is attached and where that puts it."""
