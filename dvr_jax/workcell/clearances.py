"""Clearances: how far apart a planned motion keeps the bodies that must not touch.

A motion that is free of collisions in the model can still touch something when it is executed: servos lag, objects do
not stand exactly where the camera saw them, and shapes are known to a millimetre at best. The planner therefore asks
for a distance of its own for each kind of pair. The values were found by trial: ``python -m dvr_jax.bench execute``
measures how many executed plans succeed with them.

Where a scene leaves less room than a clearance, the clearance shrinks:

- A gripper of the opening W that closes around an object of the width w has ``(W - w) / 2`` on either side. The
  collision capsules of the fingers reach beyond the pads by `Robot.pad_overhang`. Towards this object, shortly before
  it is grasped and shortly after it is released, the clearance of the hand is at most ``(W - w) / 2 - overhang -
  GRIP_ROOM``.
- Two bodies that stand nearer to each other at the start than the clearance need only keep that distance.
- A footprint that has little more room in its region than the clearance is centered, up to a quarter of that room.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from dvr_jax.errors import OptionError

GRIP_ROOM = 5e-4
"""How much of the room beside a wide object is left to the tolerances of the solver, on either side [m]."""

LIFT_MARGIN = 2e-3
"""How much higher than `Clearances.lift` the planner carries objects, because between two slices a feasible path may
fall short of a distance by as much [m]."""

EDGE_MARGIN = 1e-3
"""How much farther than `Clearances.region_edge` the planner keeps footprints from the edges of a region, because a
feasible point may fall short of it by as much [m]."""

LARGEST_FACTOR = 3.0
"""Largest factor by which a user can scale the clearances."""


@dataclass(frozen=True, slots=True)
class Clearances:
    """Least distances that planned motions keep, by the kind of pair [m]."""

    hand_to_object: float = 0.005
    """Of a hand and its fingers from an object that they do not hold, and from a fixed body."""

    link_to_object: float = 0.010
    """Of all other links from an object or a fixed body."""

    arm_to_arm: float = 0.006
    """Of the links of two arms from each other."""

    link_to_table: float = 0.010
    """Of a link above the table."""

    hand_to_table: float = 0.002
    """Of a hand and its fingers above the table. Their capsules reach 6 mm beyond the finger tips."""

    object_to_object: float = 0.005
    """Of an object that is held or was placed from all others and from the fixed bodies."""

    lift: float = 0.010
    """Of a held object above the table, except shortly before it is placed and shortly after it was grasped."""

    approach: float = 0.05
    """How far a hand comes straight to a grasp, and leaves an object that it has released."""

    region_edge: float = 0.004
    """Of the footprint of a placed object from the edges of its region."""

    def scaled(self, factor: float) -> Clearances:
        """Return these clearances times a factor.

        Raises:
            OptionError: The factor is no number from 0 to `LARGEST_FACTOR`.
        """
        if not (math.isfinite(factor) and 0 <= factor <= LARGEST_FACTOR):
            raise OptionError(f"the clearance is {factor:g}; valid is 0 to {LARGEST_FACTOR:g}.")
        return Clearances(
            **{field.name: factor * getattr(self, field.name) for field in fields(self)}
        )


DEFAULT_CLEARANCES = Clearances()
"""The clearances of a workcell that states none."""
