"""The motions that the tests of the execution start from: made by hand, with room between fingers and objects."""

import pytest
from puppet import Case, carry_to_goal, handover_of_a_bar

from dvr_jax.scene.types import SceneObject


@pytest.fixture(scope="session")
def carry() -> Case:
    """A box is carried onto the goal."""
    box = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (-0.20, 0.20), 0.3)
    return carry_to_goal(box, 0.025)


@pytest.fixture(scope="session")
def carry_cylinder() -> Case:
    """A cylinder is carried onto the goal."""
    tin = SceneObject("tin", "cylinder", (0.03, 0.10), (-0.20, 0.20), 0.3)
    return carry_to_goal(tin, 0.03)


@pytest.fixture(scope="session")
def handover() -> Case:
    """The left arm lifts a bar at one end, the right arm takes it at the other and puts it down on the goal."""
    return handover_of_a_bar()
