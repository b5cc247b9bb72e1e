"""The operator "place": an arm puts the object that it holds upright onto the table, a region or another object.

The mode parameters of a place are (x, y, yaw, bottom); `dvr_jax.modes.placed` defines them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.footprint import Rectangle, fits
from dvr_jax.geometry.intrusion import intrusion
from dvr_jax.geometry.vectors import materialize, rotation_about_z, vector
from dvr_jax.goals import TABLE, Inside
from dvr_jax.logic import Action, shipped_action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators.operator import (
    FREE,
    ModeSwitch,
    ObjectMode,
    Operator,
    Parameter,
    SkeletonState,
    body_index,
)
from dvr_jax.operators.proposal import (
    BeamStep,
    ObjectBefore,
    Proposal,
    ProposedPoses,
    held_frame,
    of_arm,
    of_item,
    of_switched_object,
    world_gripper,
)
from dvr_jax.operators.tops import height_of_top, refute_top, top_of
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.start import cleared_regions
from dvr_jax.scene.types import Scene, SceneObject, Support
from dvr_jax.workcell.clearances import EDGE_MARGIN

PLACING_ROOM = 3e-4
"""Least distance by which the center of an object can be shifted on a region, to either side [m]."""

OVERHANG_TOLERANCE = 1e-3
"""Largest distance by which a footprint may extend beyond its support on each side [m], the tolerance of the NLP."""

PLACING_RADIUS = (0.3, 0.8)
"""Least and largest distance from the arm's base of proposed placements on a large support [m]."""

PLACING_ANGLE = 1.6
"""Largest angle of these placements from straight ahead of the arm, in both directions [rad]."""

LARGE_SUPPORT = 0.5
"""A support is large, and only the part in front of the arm is used, if its half extent is above this [m]."""

SIBLING_PENALTY = 0.003
"""Penalty on the violation of a placement for each better sibling in the beam [m]."""


def _clear_rectangle(scene: Scene, item: SceneObject, support: str, place: Support) -> Rectangle:
    """Return the part of a support in which the footprint of an object stays, or its center.

    It keeps the clearance from the edges of a region. Where the footprint, with sides parallel to those of the region,
    has little more room than that, it is centered: a quarter of the room, and at least `PLACING_ROOM`, is left to the
    position. Without any room left, the only feasible position would be an isolated point, at which the constraints
    have no finite multipliers.
    """
    rectangle = place.area
    if support == TABLE:
        return rectangle

    hx, hy, _, radius = _inner_prism(item, place)
    width, depth = rectangle.half
    room = max(
        min(width - hx - radius, depth - hy - radius),
        min(width - hy - radius, depth - hx - radius),
    )
    left = max(room / 4, PLACING_ROOM)
    wanted = scene.workcell.clearances.region_edge
    if wanted > 0:
        wanted += EDGE_MARGIN
    edge = max(min(wanted, room - left), 0.0)
    return Rectangle(rectangle.center, (width - edge, depth - edge), rectangle.yaw)


def _inner_prism(item: SceneObject, place: Support) -> tuple[float, float, float, float]:
    """Return the prism of an object whose outline has to lie within a support; a point where only its center has to."""
    hx, hy, hz, radius = item.kind.prism(item.size)
    if place.inside == Inside.CENTER:
        return 0.0, 0.0, hz, 0.0
    return hx, hy, hz, radius


def _kept_clear(scene: Scene, support: str, place: Support) -> tuple[Rectangle, ...]:
    """Return the regions that a place keeps off, because the goal wants them to be clear.

    They are enlarged by the clearance that objects on a region keep from its edge. Regions on other bodies do not
    matter, because they lie higher or lower.
    """
    edge = scene.workcell.clearances.region_edge
    regions = [scene.region(name) for name in cleared_regions(scene) if name != support]
    areas = [region.footprint for region in regions if region.support == place.owner]
    return tuple(
        Rectangle(area.center, (area.half[0] + edge, area.half[1] + edge), area.yaw)
        for area in areas
    )


def _refute(scene: Scene, action: Action) -> str | None:
    """Return why an object does not fit on a region or on another object, or None."""
    _, name, support = action.arguments
    place = scene.supports().get(support)
    if place is None:
        return refute_top(scene.objects[scene.object_index(support)])
    if support == TABLE or place.inside == Inside.CENTER:
        return None

    rectangle = scene.region(support).footprint
    width, depth = (2 * half for half in rectangle.half)
    spare = 2 * OVERHANG_TOLERANCE
    footprint = scene.objects[scene.object_index(name)].footprint
    if fits(footprint, (width + spare, depth + spare)):
        return None
    return (
        f"{name} does not fit on the {support} region of {100 * width:.1f} x {100 * depth:.1f} cm"
    )


def _is_duplicate(scene: Scene, action: Action) -> bool:
    """Return False, because no two places mean the same."""
    return False


def _switch(state: SkeletonState, action: Action) -> ModeSwitch:
    """Return the mode switch of a place: the object stands on the support, and the gripper is open."""
    arm_name, name, support = action.arguments
    arm = state.scene.workcell.arm_index(arm_name)
    opening = list(state.finger_opening)
    opening[arm] = state.scene.workcell.robot.finger_travel
    place = state.scene.supports().get(support)
    if place is None:
        owner = state.scene.object_index(support)
        height = height_of_top(state, owner)
    else:
        owner = body_index(state.scene, place.owner)
        height = place.height

    switch = ModeSwitch(
        item=state.scene.object_index(name),
        acting_arm=arm,
        arms_at_rest=frozenset({arm}),
        mode=ObjectMode(ModeKind.PLACED, support=owner, bottom=height),
        lower=(-FREE, -FREE, -FREE, height),
        upper=(FREE, FREE, FREE, height),
        finger_opening=tuple(opening),
    )
    if place is None:
        return replace(switch, top=top_of(state.scene, support))
    item = state.scene.objects[switch.item]
    return replace(
        switch,
        support=_clear_rectangle(state.scene, item, support, place),
        inner_prism=_inner_prism(item, place),
        kept_clear=_kept_clear(state.scene, support, place),
    )


def propose_place(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Propose placements of a held object inside the support's rectangle, and on a large support in front of the arm.

    Args:
        step: The action of each prefix. Its supports may differ between candidates; they have an axis of candidates
            then.
        before: How the gripper holds the object.
        u: Uniform random numbers in [0, 1).
    """
    return _propose_place(of_switched_object(step), before, u)


@Program
def _propose_place(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Do the work of `propose_place`, for the switched objects alone."""
    area = step.support[:, None] if step.support.ndim == 2 else step.support
    support: list[Array] = [area[..., None, i] for i in range(5)]
    prism = [of_item(step.prism[..., i], step) for i in range(4)]
    inner = [step.inner_prism[:, None, None, i] for i in range(4)]

    # If the object barely fits on a region, only yaws parallel to its sides are possible, so half of the proposals use
    # these four yaws. The other yaws are uniform.
    turn = jnp.where(u[1] < 0.5, jnp.floor(4 * u[0]) * (math.pi / 2), 2 * math.pi * u[0])
    spare_x, spare_y = _spare_room(support, inner, turn)
    room_x = jnp.maximum(spare_x, 0)
    room_y = jnp.maximum(spare_y, 0)
    # An object that does not fit at this yaw sticks out on both sides.
    overhang = jnp.maximum(-spare_x, 0) + jnp.maximum(-spare_y, 0)

    # Position in the support's frame: anywhere on a small support, in front of the arm on a large one.
    ahead_x, ahead_y = _ahead_of_arm(step, u, support)
    is_large = support[3] > LARGE_SUPPORT
    along_x = jnp.where(is_large, jnp.clip(ahead_x, -room_x, room_x), (2 * u[2] - 1) * room_x)
    along_y = jnp.where(is_large, jnp.clip(ahead_y, -room_y, room_y), (2 * u[3] - 1) * room_y)

    # Position and yaw in the world, and the pose of the gripper that holds the object there.
    c = jnp.cos(support[2])
    s = jnp.sin(support[2])
    x = support[0] + c * along_x - s * along_y
    y = support[1] + s * along_x + c * along_y
    x, y, yaw = materialize((x, y, jnp.broadcast_to(turn + support[2], x.shape)))
    R = rotation_about_z(*materialize((jnp.cos(yaw), jnp.sin(yaw))))
    shape = (*x.shape[:1], before.parameters.shape[1], *x.shape[2:])
    bottom = jnp.broadcast_to(step.parameter_lower[:, None, None, 3], x.shape)
    R, p = world_gripper(R, vector(x, y, bottom + prism[2]), held_frame(before), shape)

    m = jnp.stack(jnp.broadcast_arrays(x, y, yaw, bottom))
    for number in range(step.kept_clear.shape[1]):
        region = step.kept_clear[:, number].T[..., None, None]
        outline = jnp.stack([prism[0], prism[1], prism[3]])
        overhang = overhang + jnp.maximum(intrusion(m, outline, region)[0], 0)
    return ProposedPoses(
        jnp.broadcast_to(m, (4, *shape)),
        R[None],
        p[None],
        jnp.broadcast_to(overhang, shape),
    )


def _spare_room(support: list[Array], prism: list[Array], turn: Array) -> tuple[Array, Array]:
    """Return how far the center may be from the support's center along both sides [m]; negative if it does not fit."""
    c = jnp.abs(jnp.cos(turn))
    s = jnp.abs(jnp.sin(turn))
    spare_x = support[3] - (c * prism[0] + s * prism[1] + prism[3])
    spare_y = support[4] - (s * prism[0] + c * prism[1] + prism[3])
    return spare_x, spare_y


def _ahead_of_arm(step: BeamStep, u: Array, support: list[Array]) -> tuple[Array, Array]:
    """Draw positions uniformly over a ring sector in front of the acting arm's base, in the support's frame [m]."""
    base = of_arm(step.base_position, step.acting_arm)
    rotation = of_arm(step.base_rotation, step.acting_arm)
    near, far = PLACING_RADIUS
    radius = jnp.sqrt(near**2 + u[2] * (far**2 - near**2))
    angle = (2 * u[3] - 1) * PLACING_ANGLE

    # The lateral axis is reversed if it does not point to +y (or to +x for an arm that faces along y), so that arms
    # that are mirror images of each other get proposals that are mirror images of each other.
    forward = rotation[:, :, 0]
    lateral = rotation[:, :, 1]
    sign = jnp.where(lateral[:, 0] + lateral[:, 1] < 0, -1, 1)[:, None]
    lateral = sign * lateral
    offsets = [
        forward[:, i, None, None] * jnp.cos(angle) + lateral[:, i, None, None] * jnp.sin(angle)
        for i in range(2)
    ]
    from_x, from_y = (base[:, i, None, None] + radius * offsets[i] - support[i] for i in range(2))

    c = jnp.cos(support[2])
    s = jnp.sin(support[2])
    return c * from_x + s * from_y, c * from_y - s * from_x


PLACEMENT = Proposal("place", propose_place, SIBLING_PENALTY)
"""How a placement is sampled."""


def _proposal(before: ModeKind) -> Proposal:
    """Return how a placement is sampled, which does not depend on the mode before it."""
    return PLACEMENT


PLACE = Operator(
    name="place",
    parameters=(Parameter.ARM, Parameter.OBJECT, Parameter.SUPPORT),
    pddl=shipped_action("place"),
    phrase="{0} places {1} on {2}",
    mode_after=ModeKind.PLACED,
    refute=_refute,
    is_duplicate=_is_duplicate,
    switch=_switch,
    proposal=_proposal,
)
"""The operator by which an arm puts down the object that it holds."""
