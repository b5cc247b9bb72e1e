"""The nonlinear program of one skeleton as arrays, and its decision variables.

A skeleton of K actions has K phases; action k (0..K-1) is the mode switch at the end of phase k. With S steps a phase
there are T = K S slices; slice t = 0..T-1 lies in phase t // S, and t = k S + S - 1 is the slice of switch k. S = 1
gives the keyframes. N is the number of objects, F of fixed bodies, A of arms, D of joints of all arms.

Skeletons are *data*: two problems with the same K, S, N, F and the same workcell structure differ in the entries of
these arrays only, so they share one compilation and can be stacked along a leading axis.
"""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array


class Variables(NamedTuple):
    """Decision variables of one NLP."""

    q: Float[Array, "*batch slices joints"]
    """Joint angles of all arms [rad], arm after arm."""

    m: Float[Array, "*batch phases 4"]
    """Mode parameters of each action; see `dvr_jax.modes`."""


class Problem(NamedTuple):
    """Arrays of one NLP; every leaf may carry leading batch axes."""

    prism: Float[Array, "*batch objects 4"]
    """Shapes of the objects as prisms (hx, hy, hz, r) [m]; see `dvr_jax.geometry.prisms`."""

    initial_pose: Float[Array, "*batch objects 4"]
    """Initial x, y, z [m] of the objects' centers and their yaw [rad]."""

    fixed_prism: Float[Array, "*batch fixed 4"]
    """Shapes of the fixed bodies."""

    fixed_pose: Float[Array, "*batch fixed 4"]
    """Poses x, y, z, yaw of the fixed bodies."""

    base_rotation: Float[Array, "*batch arms 3 3"]
    """Rotations of the arms' bases in the world."""

    base_position: Float[Array, "*batch arms 3"]
    """Positions of the arms' bases in the world [m]."""

    home: Float[Array, "*batch joints"]
    """Home posture of all arms [rad]; a path starts there at rest."""

    regularization_target: Float[Array, "*batch slices joints"]
    """Posture that each slice is drawn to [rad]: home for keyframes, the initial path for a path."""

    regularization_weight: Float[Array, "*batch slices joints"]
    """Weight of the squared distance from it [1/rad^2]; a cost, so it never decides feasibility."""

    mode_kind: Int[Array, "*batch phases+1 objects"]
    """`ModeKind` of each object in phase k; row K is the state after the last action."""

    mode_parent: Int[Array, "*batch phases+1 objects"]
    """Arm that holds each object in phase k; 0 where it is not held."""

    mode_action: Int[Array, "*batch phases+1 objects"]
    """Action whose mode parameters the object is attached by; 0 where it is attached by none."""

    switched_object: Int[Array, "*batch phases"]
    """Object that action k switches."""

    acting_arm: Int[Array, "*batch phases"]
    """Arm that carries out action k."""

    arm_at_rest: Float[Array, "*batch phases arms"]
    """1 for each arm that rests at switch k, else 0: arms that take part, and in a path all of them at its end."""

    finger_opening: Float[Array, "*batch phases+1 arms"]
    """Distance of each finger from the hand's middle plane in phase k, and after the last action [m]."""

    on_support: Float[Array, "*batch phases"]
    """1 for an action that puts its object on a support, else 0."""

    closing_yaw: Float[Array, "*batch phases"]
    """Yaw of the closing axis in the object's frame [rad]; 0 where the action's mode has none."""

    parameter_lower: Float[Array, "*batch phases 4"]
    """Lower bounds of the mode parameters; as good as none where they are -1000."""

    parameter_upper: Float[Array, "*batch phases 4"]
    """Upper bounds; a parameter whose two bounds are equal is pinned."""

    support: Float[Array, "*batch phases 5"]
    """Rectangle of the support that the object is put on: center x, y, yaw, half extents; unused without one."""

    sample_fraction: Float[Array, "*batch slices samples"]
    """Where in the interval before each slice distances are taken, from 0 (the slice before) to 1 (this one);
    increasing, the last one 1. Keyframes have one sample: nothing connects them."""

    sample_offset: Float[Array, "*batch slices samples joints"]
    """By how much the motion deviates from a straight line in joint space at each sample [rad]."""


def number_of_phases(problem: Problem) -> int:
    """Number K of actions of a problem without batch axes."""
    return len(problem.switched_object)
