"""Confirms the reasons of the refuted sequences that a plan reports (`dvr_jax.search.counterfactual`)."""

from __future__ import annotations

from dataclasses import replace

import jax

from dvr_jax.planning.result import Plan
from dvr_jax.search.counterfactual import confirm


def with_causes(result: Plan) -> Plan:
    """Return a plan whose refuted sequences have confirmed reasons, where a single change of the scene confirms one.

    Reasons that no change confirms stay symptoms.

    Args:
        result: A plan that is not solved.

    Returns:
        The plan with the reasons.
    """
    scene = result.scene.with_clearance(float(result.options.get("clearance", 1.0)))  # type: ignore[arg-type]
    seed = int(result.options.get("seed", 0))  # type: ignore[call-overload]
    cases = [(item.actions, item.reason) for item in result.refuted if not item.reason.confirmed]
    with jax.enable_x64(True):
        reasons = iter(confirm(scene, cases, seed, result.operators))
    refuted = tuple(
        item if item.reason.confirmed else replace(item, reason=next(reasons))
        for item in result.refuted
    )
    return replace(result, refuted=refuted)
