"""The two kinds of network."""

from typing import Literal

Kind = Literal["dvr", "classifier"]
"""What a network predicts: whether an action is promising for the goal, or whether the sequence so far is feasible."""
