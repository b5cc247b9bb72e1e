"""Three-vectors, rotations and poses as arrays whose *component axes come first*.

Notation: a vector field over a batch of shape ``(*b,)`` is an array ``(3, *b)``; a rotation matrix field is ``(3, 3, *b)``
with ``R[i, j]`` row i, column j. Components lead and the batch trails because XLA's CPU backend vectorises along the last
axis: a batch of 80 capsule pairs fills its SIMD lanes, a trailing axis of length three does not.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def dot(a: Array, b: Array) -> Array:
    """Inner product of vectors ``(3, *b)``, shape ``(*b,)``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors ``(3, *b)``."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def norm(a: Array) -> Array:
    """Euclidean norm of vectors ``(3, *b)``, with a derivative of zero (not NaN) at the zero vector."""
    square = dot(a, a)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def normalize(a: Array) -> Array:
    """Unit vector along ``a``; the zero vector stays zero."""
    length = norm(a)
    return a / jnp.where(length > 0, length, 1)


def rotate(R: Array, a: Array) -> Array:
    """``R a``: rotation matrices ``(3, 3, *b)`` applied to vectors ``(3, *b)``."""
    return jnp.stack([R[i, 0] * a[0] + R[i, 1] * a[1] + R[i, 2] * a[2] for i in range(3)])


def rotate_back(R: Array, a: Array) -> Array:
    """``R^T a``: the inverse rotation applied to vectors ``(3, *b)``."""
    return jnp.stack([R[0, i] * a[0] + R[1, i] * a[1] + R[2, i] * a[2] for i in range(3)])


def compose_rotations(R: Array, Q: Array) -> Array:
    """Product ``R Q`` of rotation matrices ``(3, 3, *b)``."""
    return jnp.stack(
        [jnp.stack([R[i, 0] * Q[0, j] + R[i, 1] * Q[1, j] + R[i, 2] * Q[2, j] for j in range(3)]) for i in range(3)]
    )


def transpose(R: Array) -> Array:
    """Inverse rotation: the first two axes swapped."""
    return jnp.swapaxes(R, 0, 1)


def rotation_about_z(angle: Array) -> Array:
    """Rotation matrices ``(3, 3, *b)`` about z by ``angle`` [rad] of shape ``(*b,)``."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    return jnp.stack([jnp.stack([c, -s, zero]), jnp.stack([s, c, zero]), jnp.stack([zero, zero, one])])


def half_rotation_vector(R: Array) -> tuple[Array, Array]:
    """Quaternion of rotation matrices ``(3, 3, *b)`` as ``(w, v)`` with ``w >= 0``: shapes ``(*b,)`` and ``(3, *b)``.

    ``2 v`` has length ``2 sin(angle / 2)``: it equals the rotation vector to third order and vanishes at the identity only.
    """
    # w = cos(angle / 2); the antisymmetric part of R is 2 sin(angle) axis = 4 w v. Close to a half turn w goes to zero and
    # the quotient loses digits, so w is bounded below: v is then too short but still points along the axis.
    w = 0.5 * jnp.sqrt(jnp.maximum(1 + R[0, 0] + R[1, 1] + R[2, 2], 0.01))
    antisymmetric = jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return w, antisymmetric / (4 * w)


def rotation_angle(R: Array) -> Array:
    """Angle [rad] in [0, pi] of rotation matrices ``(3, 3, *b)``, accurate at both ends of the range."""
    sine = 0.5 * norm(jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1)
    return jnp.arctan2(sine, cosine)
