"""The motions that most tests of the check start from."""

import pytest
from puppet import Case, carry_to_goal, handover_of_a_bar

from dvr_jax.scene.types import SceneObject


@pytest.fixture(scope="session")
def carry() -> Case:
    """A box is carried onto the goal."""
    return carry_to_goal(
        SceneObject("yellow", "box", (0.05, 0.08, 0.10), (-0.20, 0.20), 0.3), 0.025
    )


@pytest.fixture(scope="session")
def carry_cylinder() -> Case:
    """A cylinder is carried onto the goal."""
    return carry_to_goal(SceneObject("tin", "cylinder", (0.03, 0.10), (-0.20, 0.20), 0.3), 0.03)


@pytest.fixture(scope="session")
def carry_beside() -> Case:
    """The same, grasped 1 cm beside the cylinder's axis."""
    return carry_to_goal(
        SceneObject("tin", "cylinder", (0.03, 0.10), (-0.20, 0.20), 0.3), 0.03, offset=0.01
    )


@pytest.fixture(scope="session")
def handover() -> Case:
    """The left arm lifts a bar at one end, the right arm takes it at the other and puts it down on the goal."""
    return handover_of_a_bar()
