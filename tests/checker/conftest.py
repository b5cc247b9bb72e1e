"""The motions that most tests of the check start from."""

import pytest
from puppet import Case, carried_box, carried_tin, handover_of_a_bar


@pytest.fixture(scope="session")
def carry() -> Case:
    """A box is carried onto the goal."""
    return carried_box()


@pytest.fixture(scope="session")
def carry_cylinder() -> Case:
    """A cylinder is carried onto the goal."""
    return carried_tin()


@pytest.fixture(scope="session")
def carry_beside() -> Case:
    """The same, grasped 1 cm beside the cylinder's axis."""
    return carried_tin(offset=0.01)


@pytest.fixture(scope="session")
def handover() -> Case:
    """The left arm lifts a bar at one end, the right arm takes it at the other and puts it down on the goal."""
    return handover_of_a_bar()
