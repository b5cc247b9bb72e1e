"""The nonlinear program of one skeleton as arrays, and its decision variables.

A skeleton of K actions has K phases; action k (0..K-1) is the mode switch at the end of phase k. With S steps a phase
there are T = K S slices; slice t = 0..T-1 lies in phase t // S, and t = k S + S - 1 is the slice of switch k. S = 1
gives the keyframes.

Skeletons are *data*: two problems with the same K, S and number of objects N differ in the entries of these arrays
only, so they share one compilation and can be stacked along a leading axis."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

ABSENT, FIXED, PLACED, HELD_LEFT, HELD_RIGHT = -1, 0, 1, 2, 3
"""How an object is attached during a phase: not there at all (a relaxation), where the scene has it, where an action
placed it, in the left or the right gripper."""

PARAMETERS = 4
"""Mode parameters of an action. Grasp: offset along the face's horizontal tangent [m], offset along the object's axis
[m], pitch of the approach about the closing axis [rad] (0: straight down), yaw of the closing axis [rad] (cylinders
only). Place: x, y [m], yaw [rad] of the object in the world; the fourth is pinned to zero."""


class Variables(NamedTuple):
    """Decision variables of one NLP."""

    q: Array
    """(T, 14) joint angles [rad]: left arm's seven, then the right arm's."""
    m: Array
    """(K, 4) mode parameters; see `PARAMETERS`."""


class Problem(NamedTuple):
    """Arrays of one NLP; every leaf may carry leading batch axes."""

    half: Array
    """(N, 4) shapes of the objects as prisms (hx, hy, hz, r) [m]; see `dvr_jax.geometry.distances`."""
    initial_pose: Array
    """(N, 4) initial x, y, z [m] of the objects' centres and their yaw [rad]."""
    home: Array
    """(14,) home posture of both arms [rad]; the path starts there at rest."""
    reference: Array
    """(T, 14) posture that each slice is drawn to [rad]: home for keyframes, the start for a path."""
    attraction: Array
    """(T, 14) weight of the squared distance from it [1/rad^2]; a cost, so it never decides feasibility."""
    attachment: Array
    """(K + 1, N) int: how each object is attached in phase k; row K is the state after the last action."""
    attached_by: Array
    """(K + 1, N) int: the action whose mode parameter the attachment refers to (0 where it refers to none)."""
    switched_object: Array
    """(K,) int: the object that action k switches."""
    resting: Array
    """(K, 2): 1 for each arm that rests at switch k, else 0: those that take part, and in a path both at its end."""
    opening: Array
    """(K + 1, 2) distance of each finger from the hand's middle plane in phase k, and after the last action [m]."""
    is_grasp: Array
    """(K,): 1 for a grasp, 0 for a place."""
    face_yaw: Array
    """(K,) yaw of the closing axis in the object's frame [rad]: eta pi / 2 (0 for a place)."""
    lower: Array
    """(K, 4) lower bounds of the mode parameters [m, pitch and yaw rad]; as good as none where they are -1000."""
    upper: Array
    """(K, 4) upper bounds; a parameter with lower = upper is pinned."""
    support: Array
    """(K, 5) the rectangle of a place: centre x, y, yaw, half extents; unused for a grasp."""
    share: Array
    """(T, M) where in the interval before each slice distances are taken, from 0 (the slice before) to 1 (this one);
    increasing, the last one 1. Keyframes have M = 1: nothing connects them."""
    offset: Array
    """(T, M, 14) by how much the motion deviates from a straight line in joint space there [rad]."""
