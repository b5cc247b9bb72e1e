"""The motions that the tests of the execution start from: made by hand, with room between fingers and objects."""

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
def handover() -> Case:
    """The left arm lifts a bar at one end, the right arm takes it at the other and puts it down on the goal."""
    return handover_of_a_bar()
