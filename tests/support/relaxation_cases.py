"""Scenes in which the least number of actions, or the reason that there is no solution, is known by construction."""

from collections.abc import Sequence

from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject


def box(name: str, size: Sequence[float], position: tuple[float, float]) -> SceneObject:
    """A box whose sides are parallel to those of the table."""
    return SceneObject(name, "box", tuple(size), position, 0.0)


def single(size: Sequence[float], target: tuple[float, float], side: float = 0.2) -> Scene:
    """One box in front of the left arm, and a square target."""
    return Scene(
        (box("cube", size, (-0.4, 0.0)),), OnRegion("cube", Region(target, 0.0, (side, side)))
    )


OUT_OF_REACH = single((0.05, 0.05, 0.05), (0.0, 0.85), 0.15)
"""The target is in reach of no arm."""

TOO_WIDE = single((0.1, 0.12, 0.1), (-0.4, 0.35))
"""The gripper opens 8 cm."""

TOO_LARGE = single((0.05, 0.15, 0.1), (-0.4, 0.35), 0.1)
"""The box is longer than the target."""


def obstructed(number: int) -> Scene:
    """A target in reach of the left arm alone, on which so many small boxes stand, each of which must be moved away."""
    places = ((-0.38, 0.17), (-0.43, 0.13), (-0.43, 0.18))
    blockers = [
        box(f"b{index}", (0.03, 0.03, 0.05), place)
        for index, place in enumerate(places[:number], start=1)
    ]
    target = box("target", (0.07, 0.07, 0.05), (-0.4, -0.2))
    return Scene((target, *blockers), OnRegion("target", Region((-0.4, 0.15), 0.0, (0.09, 0.09))))


NEEDLESS_GRASP = Scene(
    (
        SceneObject("a", "cylinder", (0.02, 0.1), (-0.35, 0.15), 0.0),
        SceneObject("b", "cylinder", (0.02, 0.1), (0.3, -0.1), 0.0),
    ),
    OnRegion("a", Region((0.0, 0.0), 0.0, (0.2, 0.2))),
)
"""Two actions of the left arm suffice; the can on the right is in nobody's way."""

BYSTANDER = Scene(
    (
        box("objR", (0.06, 0.06, 0.1), (-0.45, 0.4)),
        box("objG", (0.06, 0.06, 0.1), (-0.35, 0.2)),
        box("objB", (0.06, 0.06, 0.1), (-0.45, -0.4)),
    ),
    OnRegion("objR", Region((-0.25, 0.0), 0.0, (0.07, 0.07))),
)
"""The way of the first box to a narrow target leads past the second one."""

WALLED = Scene(
    (
        box("cube", (0.05, 0.05, 0.05), (-0.4, 0.0)),
        box("wall", (0.2, 0.02, 0.3), (-0.4, 0.045)),
    ),
    OnRegion("cube", Region((-0.4, -0.3), 0.0, (0.2, 0.2))),
)
"""A cube whose +y face is next to a wall."""

HAND_STILL_FULL = Scene(
    (
        box("blocker", (0.026595, 0.035769, 0.032128), (-0.130574, -0.142544)),
        box("target", (0.056567, 0.077622, 0.05), (-0.412252, 0.183132)),
    ),
    OnRegion("target", Region((-0.102264, -0.132277), 0.0, (0.070709, 0.097028))),
)
"""A small box stands where the target is going to stand. A hand that holds the box at the end would be too near."""

BORDERLINE = Scene(
    (
        box("target", (0.04, 0.032, 0.05), (-0.45, -0.3)),
        box("b0", (0.03, 0.03, 0.05), (-0.42, -0.02)),
        box("b1", (0.025, 0.04, 0.06), (-0.38, 0.03)),
        box("b2", (0.04, 0.02, 0.03), (-0.3, 0.2)),
        box("b3", (0.02, 0.02, 0.04), (-0.5, 0.2)),
    ),
    OnRegion("target", Region((-0.4, 0.0), 0.0, (0.05, 0.04))),
)
"""The second blocker overlaps with each placement of the target by little more than the tolerances of the check."""

NO_LIFT = Scene(
    (
        SceneObject(
            "yellow",
            "box",
            (0.0239556, 0.0239556, 0.0239556),
            (-0.1808518, -0.6950229),
            -0.8857563,
        ),
    ),
    OnRegion("yellow", Region((-0.3145364, 0.0438701), 0.8326607, (0.0384606, 0.0384606))),
)
"""The left arm, which alone reaches the cube, has keyframes of all grasps, but no straight motion to the cube."""

NO_LIFT_ACTIONS = ("grasp(left, -y, yellow)", "place(left, yellow, goal)")
"""A sequence whose keyframes are feasible there."""
