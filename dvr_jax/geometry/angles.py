"""Angles from their sines and cosines, by arithmetic alone.

XLA's CPU backend calls the C library for every single arctangent, 12 to 17 ns each (and 26 for an arccosine); inverse
kinematics takes eleven a pose for thousands of poses. A polynomial runs over whole vectors."""

from __future__ import annotations

import math
from functools import cache

import jax.numpy as jnp
import numpy as np

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize


@cache
def _coefficients(terms: int) -> tuple[float, ...]:
    """Of arctan(t) / t as a polynomial in t^2 on [0, 1], lowest first: interpolation at Chebyshev points, whose error
    falls by a factor of 5.8 a term (the nearest singularity is at t^2 = -1)."""

    def ratio(z: np.ndarray) -> np.ndarray:
        t = np.sqrt(z)
        return np.arctan(t) / t

    fit = np.polynomial.Chebyshev.interpolate(ratio, terms - 1, domain=[0, 1])
    return tuple(float(c) for c in fit.convert(kind=np.polynomial.Polynomial).coef)


def arctan2(y: Array, x: Array) -> Array:
    """Angle of (x, y) [rad] in [-pi, pi], to 4e-7 in float32 and 4e-15 in float64; 0 at the origin.

    At y = 0 and x < 0 it is pi, whatever the sign of the zero."""
    coefficients = _coefficients(10 if x.dtype == jnp.float32 else 21)
    a, b = jnp.abs(x), jnp.abs(y)
    larger, smaller = jnp.maximum(a, b), jnp.minimum(a, b)
    t = materialize(smaller / jnp.where(larger > 0, larger, 1))
    z = t * t
    value = jnp.full_like(z, coefficients[-1])
    for c in coefficients[-2::-1]:
        value = value * z + c
    value = value * t
    value = jnp.where(b > a, math.pi / 2 - value, value)
    value = jnp.where(x < 0, math.pi - value, value)
    return jnp.where(y < 0, -value, value)
