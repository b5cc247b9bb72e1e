"""The workcell: which robot stands where, and on which table.

World frame: the table's top is the plane z = 0, z points up. Meters and radians. The usual workcell of the paper has
two Franka Panda arms that face each other 1.5 m apart; others differ in the arms' bases, homes and number only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from dvr_jax.errors import DvrError, OptionError
from dvr_jax.geometry import footprint as footprints
from dvr_jax.workcell.clearances import DEFAULT_CLEARANCES, Clearances
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import Rectangle, Robot

Home = tuple[tuple[float, ...], ...]
"""Joint angles of every arm [rad]."""


@dataclass(frozen=True, slots=True)
class Arm:
    """One robot arm of a workcell: its name, where its base stands, and the posture in which it starts."""

    name: str
    """Unique in its workcell; actions and messages use it."""

    position: tuple[float, float]
    """Position (x, y) of the base on the table [m]."""

    yaw: float
    """Turn of the base about the world's z axis [rad]; at 0 the arm looks along +x."""

    home: tuple[float, ...] = PANDA.home
    """Joint angles at the start of every motion [rad]."""


@dataclass(frozen=True, slots=True)
class Table:
    """The table: a slab whose top is the plane z = 0, centered at the world's origin."""

    half_extents: tuple[float, float] = (1.1, 1.0)
    """Half extents of the top along x and y [m]."""

    thickness: float = 0.04
    """The slab reaches from z = -thickness to z = 0 [m]."""

    @property
    def footprint(self) -> footprints.Rectangle:
        """The top."""
        return footprints.Rectangle((0.0, 0.0), self.half_extents, 0.0)


@dataclass(frozen=True, slots=True)
class Workcell:
    """One or more arms of the same robot on a table."""

    arms: tuple[Arm, ...]
    """The arms, in a fixed order; arrays with an axis of arms follow it."""

    robot: Robot = PANDA
    """The robot that all arms are."""

    table: Table = Table()
    """The table that arms and objects stand on."""

    clearances: Clearances = DEFAULT_CLEARANCES
    """Distances that planned motions keep."""

    @property
    def number_of_arms(self) -> int:
        """Number A of arms."""
        return len(self.arms)

    @property
    def number_of_joints(self) -> int:
        """Number D of revolute joints of all arms together."""
        return len(self.arms) * self.robot.number_of_joints

    @property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(arm.name for arm in self.arms)

    @property
    def home(self) -> Home:
        """Home posture of every arm [rad]."""
        return tuple(arm.home for arm in self.arms)

    def arm_index(self, name: str) -> int:
        """Return the index of the arm of this name.

        Raises:
            DvrError: The workcell has no such arm.
        """
        if name not in self.arm_names:
            raise DvrError(f"there is no arm '{name}'; valid: {', '.join(self.arm_names)}.")
        return self.arm_names.index(name)


LARGEST_ARM_CLEARANCE = 0.02
"""Pairs of capsules of two arms count that can come as near to each other as this, whatever the clearances are [m]."""


def base_rotation(arm: Arm) -> Float[np.ndarray, "3 3"]:
    """Rotation of an arm's base frame in the world."""
    cosine = math.cos(arm.yaw)
    sine = math.sin(arm.yaw)
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    # The sine of pi is 1e-16; exact zeros make an arm that is turned by half an exact mirror image.
    rotation[np.abs(rotation) < 1e-12] = 0
    return rotation


def base_rotations(workcell: Workcell) -> Float[np.ndarray, "arms 3 3"]:
    """Rotations of all base frames in the world."""
    return np.stack([base_rotation(arm) for arm in workcell.arms])


def base_positions(workcell: Workcell) -> Float[np.ndarray, "arms 3"]:
    """Positions of all bases in the world [m]."""
    return np.array([[*arm.position, 0.0] for arm in workcell.arms])


def cross_arm_pairs(workcell: Workcell) -> tuple[tuple[int, int, Rectangle], ...]:
    """Pairs of capsules of different arms that can meet: (first arm, second arm, pairs of their capsules).

    Capsules whose reaches (`Robot.capsule_reach`) together are shorter than the distance of the bases cannot meet.
    """
    pairs = []
    # A running maximum makes the reach increase along the arm, so that few rectangles of capsules cover all pairs.
    reach = np.maximum.accumulate(workcell.robot.capsule_reach)
    for (a, first), (b, second) in combinations(enumerate(workcell.arms), 2):
        distance = math.dist(first.position, second.position) - LARGEST_ARM_CLEARANCE
        pairs += [(a, b, rectangle) for rectangle in _reachable_pairs(reach, distance)]
    return tuple(pairs)


def _reachable_pairs(reach: Float[np.ndarray, " capsules"], distance: float) -> list[Rectangle]:
    """Rectangles of capsule pairs (i, j) with ``reach[i] + reach[j] >= distance``, for an increasing reach.

    The rectangle of the first arm's hand comes first.
    """
    number = len(reach)
    nearest = [int(np.searchsorted(reach, distance - own)) for own in reach]
    rectangles: list[Rectangle] = []
    first = 0
    for i in range(1, number + 1):
        if i == number or nearest[i] != nearest[first]:
            if nearest[first] < number:
                rectangles.append(((first, i), (nearest[first], number)))
            first = i
    return rectangles[::-1]


def facing_workcell(distance: float) -> Workcell:
    """Two Pandas, "left" and "right", that face each other along x.

    Args:
        distance: Distance of the two bases [m].
    """
    return Workcell(
        (
            Arm("left", (-distance / 2, 0.0), 0.0),
            Arm("right", (distance / 2, 0.0), math.pi),
        )
    )


DEFAULT_WORKCELL = facing_workcell(1.5)
"""The workcell of the paper's experiments: both arms reach the middle of the table, each alone what lies behind its own
base. The shipped networks were trained in it."""

SIDE_BY_SIDE_WORKCELL = Workcell(
    (
        Arm("left", (-0.4, -0.3), math.pi / 2),
        Arm("right", (0.4, -0.3), math.pi / 2),
    )
)
"""Two Pandas 0.8 m apart that both look along +y."""

SINGLE_ARM_WORKCELL = Workcell((Arm("arm", (0.0, -0.4), math.pi / 2),))
"""One Panda that looks along +y."""

WORKCELLS: dict[str, Workcell] = {
    "facing": DEFAULT_WORKCELL,
    "facing-1.0": facing_workcell(1.0),
    "facing-1.6": facing_workcell(1.6),
    "side-by-side": SIDE_BY_SIDE_WORKCELL,
    "single": SINGLE_ARM_WORKCELL,
}
"""Workcells by the names that commands use."""


def named_workcell(name: str) -> Workcell:
    """Return a workcell by the name that commands use.

    Raises:
        OptionError: There is no workcell of this name.
    """
    if name not in WORKCELLS:
        raise OptionError(f"there is no workcell {name!r}; valid: {', '.join(WORKCELLS)}.")
    return WORKCELLS[name]
