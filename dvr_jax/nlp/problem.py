"""The nonlinear program of one skeleton as arrays, and its decision variables.

A skeleton of K actions has K phases, numbered k = 0, ..., K - 1. At the end of phase k, action k makes its mode switch:
one object changes how it is attached. Each phase has S intervals of equal duration, and a slice is the instant at the
end of an interval. There are T = K S slices. Slice t = 0, ..., T - 1 belongs to phase t // S, and slice t = k S + S - 1
is the instant of switch k. With S = 1 the slices are the keyframes. N is the number of objects, F of fixed bodies, A of
arms, and D of joints of all arms together.

Skeletons are *data*: two problems with the same K, S, N, F and the same workcell structure differ only in the entries
of these arrays, so they share one compiled program and can be stacked along a leading axis.

The *closing axis* is the horizontal axis in the frame of a held object along which the fingers close. The modes
(`dvr_jax.modes`) define the mode parameters.
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
    """Mode parameters of each action [m or rad]; see `dvr_jax.modes`."""


class Problem(NamedTuple):
    """Arrays that define one NLP; every array may have leading batch axes."""

    prism: Float[Array, "*batch objects 4"]
    """Shapes of the objects as prisms (hx, hy, hz, r) [m]; see `dvr_jax.geometry.prisms`."""

    initial_pose: Float[Array, "*batch objects 4"]
    """Initial x, y, z [m] of the objects' centers and their yaw [rad]."""

    fixed_prism: Float[Array, "*batch fixed 4"]
    """Shapes of the fixed bodies as prisms (hx, hy, hz, r) [m]."""

    fixed_pose: Float[Array, "*batch fixed 4"]
    """Poses of the fixed bodies: x, y, z of the center [m] and yaw [rad]."""

    base_rotation: Float[Array, "*batch arms 3 3"]
    """Rotations of the arms' bases in the world."""

    base_position: Float[Array, "*batch arms 3"]
    """Positions of the arms' bases in the world [m]."""

    home: Float[Array, "*batch joints"]
    """Home posture of all arms [rad]; a path starts there at rest."""

    regularization_target: Float[Array, "*batch slices joints"]
    """Posture to which the cost pulls each slice [rad]: home for keyframes, the initial path for a path."""

    regularization_weight: Float[Array, "*batch slices joints"]
    """Weight of the squared distance from that posture in the cost [1/rad^2]; it does not affect feasibility."""

    mode_kind: Int[Array, "*batch phases+1 objects"]
    """`ModeKind` of each object in phase k; row K is the state after the last action."""

    mode_parent: Int[Array, "*batch phases+1 objects"]
    """Arm that holds each object in phase k; 0 where it is not held."""

    mode_action: Int[Array, "*batch phases+1 objects"]
    """Number of the last action that switched each object before phase k, whose mode parameters give the object's pose;
    0, without meaning, where no action has switched it yet."""

    switched_object: Int[Array, "*batch phases"]
    """Index of the object that action k switches."""

    acting_arm: Int[Array, "*batch phases"]
    """Index of the arm that carries out action k."""

    arm_at_rest: Float[Array, "*batch phases arms"]
    """1 for each arm that rests at switch k, else 0: in keyframes the arms that take part, in a path all of them."""

    straight_arm: Int[Array, "*batch phases 2"]
    """Arm of each straight motion of a path: one that leaves the last switch, and one that comes to the next one."""

    straight_distance: Float[Array, "*batch phases 2"]
    """Least length of each straight motion [m]; 0 where there is none."""

    straight_kind: Int[Array, "*batch phases 2"]
    """`StraightKind` of each straight motion: along the approach axis of the hand, or vertical."""

    still_arm: Float[Array, "*batch phases 2 arms"]
    """1 for each arm that rests during a straight motion, because it holds the object, else 0."""

    finger_opening: Float[Array, "*batch phases+1 arms"]
    """Distance of each finger from the hand's middle plane in phase k, and after the last action [m]."""

    on_support: Float[Array, "*batch phases"]
    """1 for an action that puts its object on a support, else 0."""

    closing_yaw: Float[Array, "*batch phases"]
    """Yaw of the closing axis in the object's frame [rad]; 0 for an action that does not grasp."""

    parameter_lower: Float[Array, "*batch phases 4"]
    """Lower bounds of the mode parameters [m or rad]; -1000 means that there is no bound."""

    parameter_upper: Float[Array, "*batch phases 4"]
    """Upper bounds of the mode parameters [m or rad]; a parameter whose two bounds are equal is *pinned*: it is
    constant."""

    preference: Float[Array, "*batch phases 4"]
    """Weights of the squared mode parameters in the cost [1/m^2 or 1/rad^2]; they do not affect feasibility."""

    preference_scale: Float[Array, "*batch"]
    """Factor of these weights: 1 where an optimal path is sought, 0 where a feasible point will do."""

    support: Float[Array, "*batch phases 5"]
    """Rectangle on which the object is placed: center x, y [m], yaw [rad], half extents [m]; zeros for a grasp."""

    inner_prism: Float[Array, "*batch phases 4"]
    """Prism (hx, hy, hz, r) of the part of the placed object whose outline has to lie within the support: the object
    itself, or a vertical line if only its center has to [m]; zeros for a grasp."""

    kept_clear: Float[Array, "*batch phases regions 5"]
    """Rectangles that the placed object must not cover, as `support`; zeros where there is none."""

    top_object: Int[Array, "*batch phases tops"]
    """Index of the object on which action k puts its object; 0, without meaning, where `top_half` is zero. The last
    axis has the length 1 in a scene in which objects are supports, else 0."""

    top_half: Float[Array, "*batch phases tops 2"]
    """Half extents of the area on its top, in its own frame, where the center of the upper object may be [m]."""

    phase_clearance: Float[Array, "*batch phases+1 3 body_rows"]
    """Clearances of each part of each phase, and after the last action (`dvr_jax.nlp.body_clearances`) [m]."""

    clearance: Float[Array, "*batch slices body_rows"]
    """Those of them that apply in the interval before each slice and at the slice [m]."""

    sample_fraction: Float[Array, "*batch slices samples"]
    """Where in the interval before each slice distances are evaluated, from 0 (the previous slice) to 1 (this slice).
    The fractions increase, and the last one is 1. Keyframes have a single sample, because no motion connects them."""

    sample_offset: Float[Array, "*batch slices samples joints"]
    """Deviation of the interpolated motion from a straight line in joint space at each sample [rad]. The joint angles
    at a sample of fraction s are (1 - s) q_{t-1} + s q_t + offset, with a constant offset during the optimization."""


def number_of_phases(problem: Problem) -> int:
    """Return the number K of actions of a problem without batch axes."""
    return len(problem.switched_object)
