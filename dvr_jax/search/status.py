"""How a search or a plan ended."""

from enum import StrEnum


class PlanStatus(StrEnum):
    """How a search or a plan ended; each member equals its text, which files hold."""

    SOLVED = "solved"
    """The independent check accepted the motion of a sequence."""
    EXHAUSTED = "tree exhausted"
    """The bounds, or the check, refuted every sequence of at most `k_max` actions."""
    TIME_LIMIT = "time limit"
    """The time was over before either."""
