"""Rules of a scene, and the factory that makes valid scenes only.

A scene has 1 to 8 objects and at most 16 fixed bodies with unique names, finite numbers and sensible sizes. All objects
stand fully on the table or on the top of a fixed body, off the arms' bases, and nothing overlaps but fixed bodies among
themselves. The rules of the arms are in `dvr_jax.scene.workcell_rules`, those of regions and goals in
`dvr_jax.scene.goal_rules`, those of supports and stacks in `dvr_jax.scene.support_rules` and `dvr_jax.scene.stacks`.

Whether the arms at home touch anything is not decided here, as it takes a MuJoCo model:
`dvr_jax.scene.mjcf.require_free_home`.
"""

from collections.abc import Sequence
from itertools import combinations

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import signed_distance
from dvr_jax.goals import Goal, OnRegion, Region
from dvr_jax.scene.goal_rules import validate_goal, validate_regions, validate_room
from dvr_jax.scene.rules import (
    ANY_NUMBER,
    CONTACT_TOLERANCE,
    DENSITY_RANGE,
    FRICTION_RANGE,
    LARGEST_SIZE,
    OVERLAP_TOLERANCE,
    SIZE_RANGE,
    YAW_RANGE,
    in_words,
    require_name,
    require_numbers,
    require_unique,
)
from dvr_jax.scene.stacks import require_valid_stacks, standing_on
from dvr_jax.scene.support_rules import require_on_top, require_support
from dvr_jax.scene.types import (
    MAXIMUM_FIXED_BODIES,
    MAXIMUM_OBJECTS,
    FixedBody,
    Scene,
    SceneObject,
)
from dvr_jax.scene.workcell_rules import require_off_bases, validate_workcell
from dvr_jax.shapes import shape_named, shape_names
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell

LARGEST_DISTANCE = 2.0
"""The center of a fixed body is no farther from the table's center than this, in each direction [m]."""


def make_scene(
    objects: Sequence[SceneObject],
    goal: OnRegion | Goal,
    workcell: Workcell = DEFAULT_WORKCELL,
    fixed: Sequence[FixedBody] = (),
    regions: Sequence[Region] = (),
) -> Scene:
    """Make a valid scene.

    Args:
        objects: Movable bodies.
        goal: What shall hold at the end of a plan.
        workcell: Arms and table.
        fixed: Bodies that never move.
        regions: Regions that the goal names, or that may serve as supports.

    Returns:
        The scene.

    Raises:
        SceneError: A rule is broken; the message names the first one.
    """
    scene = Scene(tuple(objects), goal, workcell, tuple(fixed), tuple(regions))
    validate_scene(scene)

    return scene


def validate_scene(scene: Scene) -> None:
    """Check all rules of a scene.

    Raises:
        SceneError: A rule is broken; the message names the first one.
    """
    _require_constant(scene)
    validate_workcell(scene.workcell)
    if not 1 <= len(scene.objects) <= MAXIMUM_OBJECTS:
        raise SceneError(
            f"the scene has {len(scene.objects)} objects; valid are 1 to {MAXIMUM_OBJECTS}."
        )
    if len(scene.fixed) > MAXIMUM_FIXED_BODIES:
        raise SceneError(
            f"the scene has {len(scene.fixed)} fixed bodies; valid are 0 to {MAXIMUM_FIXED_BODIES}."
        )

    _validate_names(scene)

    # The heights of objects are those of the fixed bodies on which they stand.
    for body in scene.fixed:
        _validate_fixed_body(body, scene.workcell)

    for item in scene.objects:
        _validate_shape_of(item)
    require_valid_stacks(scene)
    for item in scene.objects:
        _validate_object(item, scene)

    validate_regions(scene)
    validate_goal(scene)
    _validate_overlaps(scene)
    validate_room(scene)


def _require_constant(scene: Scene) -> None:
    """Models and solutions are kept by scene, so no part of a scene may change."""
    try:
        hash(scene)
    except TypeError as error:
        raise SceneError(
            f"a part of the scene can change ({error}); valid are tuples instead of lists."
        ) from None


def _validate_names(scene: Scene) -> None:
    for name in scene.object_names:
        require_name("an object", name)

    for body in scene.fixed:
        require_name("a fixed body", body.name)

    require_unique("objects", scene.object_names)
    require_unique(
        "objects and fixed bodies",
        scene.object_names + tuple(body.name for body in scene.fixed),
    )


def _validate_body(
    what: str,
    body: SceneObject | FixedBody,
    valid_position: tuple[float, float] = ANY_NUMBER,
) -> None:
    """Check what objects and fixed bodies have in common."""
    if body.shape not in shape_names():
        valid = " and ".join(map(repr, shape_names()))
        raise SceneError(f"{what} has the shape {body.shape!r}; valid are {valid}.")

    count = len(shape_named(body.shape).size_names)
    require_numbers(f"the size of {what}", body.size, count, SIZE_RANGE, "m")
    dimensions = 2 if isinstance(body, SceneObject) else 3
    require_numbers(f"the position of {what}", body.position, dimensions, valid_position, "m")
    require_numbers(f"the yaw of {what}", (body.yaw,), 1, YAW_RANGE, "rad")


def _validate_shape_of(item: SceneObject) -> None:
    """Check the numbers of an object, whatever it stands on."""
    what = f"the object {item.name!r}"
    _validate_body(what, item)
    require_numbers(f"the density of {what}", (item.density,), 1, DENSITY_RANGE, "kg/m^3")
    require_numbers(f"the friction of {what}", (item.friction,), 1, FRICTION_RANGE, "")


def _validate_object(item: SceneObject, scene: Scene) -> None:
    """Check where an object stands; the objects below it stand where they may."""
    what = f"the object {item.name!r}"
    if item.name not in standing_on(scene):
        body = require_support(what, "stands", item.support, scene)
        where = f"{what} at {in_words(item.position)}"
        require_on_top(where, item.footprint, body, scene, CONTACT_TOLERANCE)

    bottom = scene.bottom_of(item)
    if bottom + item.height > LARGEST_SIZE:
        raise SceneError(
            f"{what} reaches {bottom + item.height:.3g} m above the table; valid are at most {LARGEST_SIZE:g} m."
        )
    require_off_bases(what, item.footprint, bottom, scene.workcell)


def _validate_fixed_body(body: FixedBody, workcell: Workcell) -> None:
    what = f"the fixed body {body.name!r}"
    _validate_body(what, body, (-LARGEST_DISTANCE, LARGEST_DISTANCE))
    if body.bottom < -OVERLAP_TOLERANCE:
        raise SceneError(
            f"{what} begins {-body.bottom:.3g} m below the table's top; valid is at its top or higher."
        )
    if body.top > LARGEST_SIZE:
        raise SceneError(
            f"{what} reaches {body.top:.3g} m above the table; valid are at most {LARGEST_SIZE:g} m."
        )

    require_off_bases(what, body.footprint, body.bottom, workcell)


def _validate_overlaps(scene: Scene) -> None:
    """Two upright prisms overlap where both their footprints and their intervals of height do."""
    for first, second in combinations(scene.objects, 2):
        depth = min(
            _common_height(_heights(scene, first), _heights(scene, second)),
            -signed_distance(first.footprint, second.footprint),
        )
        if depth > CONTACT_TOLERANCE:
            raise SceneError(
                f"the objects {first.name!r} and {second.name!r} overlap by {depth:.3g} m; move them apart."
            )

    for body in scene.fixed:
        for item in scene.objects:
            depth = min(
                _common_height(_heights(scene, item), (body.bottom, body.top)),
                -signed_distance(item.footprint, body.footprint),
            )
            if depth > CONTACT_TOLERANCE:
                raise SceneError(
                    f"the object {item.name!r} and the fixed body {body.name!r} overlap by {depth:.3g} m; "
                    "move them apart."
                )


def _heights(scene: Scene, item: SceneObject) -> tuple[float, float]:
    """Return the heights of the bottom and of the top of an object [m]."""
    bottom = scene.bottom_of(item)
    return bottom, bottom + item.height


def _common_height(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the length of the part that two intervals of height share [m]; negative if they are apart."""
    return min(first[1], second[1]) - max(first[0], second[0])
