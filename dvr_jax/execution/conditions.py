"""The physical conditions under which a plan is executed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvr_jax.errors import OptionError


@dataclass(frozen=True, slots=True)
class ExecutionConditions:
    """What a motion does not say and physics needs."""

    friction: float = 1.0
    """Factor of the coefficients of friction that the scene states for its objects."""

    grip_force: float = 70.0
    """Force of each finger of a closed gripper on its object [N]. Franka states 70 N for continuous use, which is also
    the limit of the robot's model."""

    object_noise: float = 0.0
    """Standard deviation of the initial displacement of each object along x and along y [m]."""

    seed: int = 0
    """Seed of the displacements."""

    def __post_init__(self) -> None:
        """Refuse numbers that physics cannot use."""
        for name, value, least, most, unit in (
            ("friction", self.friction, 0.0, 10.0, ""),
            ("grip force", self.grip_force, 1.0, 70.0, " N"),
            ("object noise", self.object_noise, 0.0, 0.1, " m"),
        ):
            if not (math.isfinite(value) and least <= value <= most):
                raise OptionError(
                    f"the {name} is {value:g}{unit}; valid is {least:g} to {most:g}{unit}."
                )
        if self.seed < 0:
            raise OptionError(f"the seed is {self.seed}; valid is 0 or more.")
