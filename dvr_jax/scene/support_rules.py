"""Rules of supports: objects stand, and regions lie, on the top of a known body, and do not reach off it."""

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Footprint, covers
from dvr_jax.goals import TABLE
from dvr_jax.scene.rules import OVERLAP_TOLERANCE
from dvr_jax.scene.types import FixedBody, Scene
from dvr_jax.scene.workcell_rules import table_in_words


def require_support(what: str, doing: str, name: str, scene: Scene) -> FixedBody | None:
    """Return the fixed body of a name, or None for the table; refuse any other name.

    Args:
        what: What has the support, as in "the object 'yellow'".
        doing: What it does there, as in "stands".
        name: Name of the support.
        scene: The scene.

    Raises:
        SceneError: There is no support of this name.
    """
    if name == TABLE:
        return None

    for body in scene.fixed:
        if body.name == name:
            return body

    bodies = ", ".join(repr(body.name) for body in scene.fixed) or "none here"
    raise SceneError(
        f"{what} {doing} on {name!r}; valid are {TABLE!r} and the fixed bodies ({bodies})."
    )


def require_on_top(
    what: str,
    footprint: Footprint,
    body: FixedBody | None,
    scene: Scene,
    tolerance: float = OVERLAP_TOLERANCE,
) -> None:
    """Refuse a footprint that reaches off the top on which it stands or lies.

    Args:
        what: What has the footprint, as in "the region 'plate' at (0.1, 0.2)".
        footprint: The footprint.
        body: The fixed body; None for the table.
        scene: The scene.
        tolerance: How far it may reach off the top [m].

    Raises:
        SceneError: It reaches off.
    """
    table = scene.workcell.table
    top = table.footprint if body is None else body.footprint
    if covers(top, footprint, tolerance):
        return

    if body is None:
        raise SceneError(f"{what} reaches off the table, whose top is {table_in_words(table)}.")
    raise SceneError(
        f"{what} reaches off the top of the fixed body {body.name!r}; make it smaller or move it."
    )
