"""The start of a motion, which is no action: every object stands where the scene has it."""

from __future__ import annotations

from collections.abc import Mapping

from dvr_jax.checker.operators.operator import (
    AttachmentInterval,
    OperatorCheck,
    Standing,
    Timeline,
)
from dvr_jax.checker.operators.parameter import Arguments
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.scene.types import Scene


def _refusal(arguments: Arguments, holding: Mapping[str, str]) -> str:
    return "a motion has started already."


def _attachment(scene: Scene, arguments: Arguments) -> Standing:
    return Standing()


def _check(
    motion: ReplayedMotion,
    timeline: Timeline,
    interval: AttachmentInterval,
    log: FindingLog,
) -> None:
    """Require nothing more; `dvr_jax.checker.objects` compares the first sample with the scene."""


START_CHECK = OperatorCheck(
    name="start",
    parameters=(),
    refusal=_refusal,
    attachment=_attachment,
    check=_check,
)
"""Operator of the first interval of every object."""
