"""The check of place(arm, object, support): an arm puts down what it holds.

At the switch, and for as long as the object stays, it stands upright at the height of the support with its whole bottom
within the area of the support.
"""

from __future__ import annotations

from collections.abc import Mapping

from dvr_jax.checker.operators.operator import (
    AttachmentInterval,
    OperatorCheck,
    Standing,
    Timeline,
)
from dvr_jax.checker.operators.parameter import ARM, OBJECT, SUPPORT, Arguments
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.supports import check_standing
from dvr_jax.scene.types import Scene


def _refusal(arguments: Arguments, holding: Mapping[str, str]) -> str:
    arm = arguments["arm"]
    name = arguments["object"]
    if holding.get(arm) != name:
        return f"{arm} does not hold {name}, so it cannot place it."
    return ""


def _attachment(scene: Scene, arguments: Arguments) -> Standing:
    return Standing()


def _check(
    motion: ReplayedMotion,
    timeline: Timeline,
    interval: AttachmentInterval,
    log: FindingLog,
) -> None:
    # In between, the object does not move more than any standing object may.
    for sample in (interval.start, interval.end - 1):
        check_standing(motion, interval.object, interval.arguments["support"], sample, log)


PLACE_CHECK = OperatorCheck(
    name="place",
    parameters=(ARM, OBJECT, SUPPORT),
    refusal=_refusal,
    attachment=_attachment,
    check=_check,
)
"""The operator place."""
