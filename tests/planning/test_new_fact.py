"""A fact of a user's own, defined outside of the package, in one file: a scene with it is read, planned and checked."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

import dvr_jax as dvr
from dvr_jax.checker import check_goal
from dvr_jax.checker.kinds import FindingKind
from dvr_jax.goals import EndCondition, GoalWorld
from dvr_jax.scene.files import scene_from_json, scene_to_json

STILL_HELD = FindingKind("still held", "{0} was not put back", "")


@dvr.register_fact
@dataclass(frozen=True, slots=True)
class OffRegion:
    """The object stands on the table and on no region."""

    keyword: ClassVar[str] = "off"
    object: str

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        on_table = EndCondition(("on", self.object, "table"), self.object)
        regions = [
            EndCondition(("on", self.object, region), self.object, holds=False)
            for region in world.regions
        ]
        return (on_table, *regions)

    def sentence(self) -> str:
        return f"{self.object} off all regions"


@check_goal.register
def check_off_region(fact: OffRegion, motion: Any, timeline: Any, log: Any) -> None:
    index = motion.scene.object_index(fact.object)
    if timeline.last(index).holder is not None:
        log.add(STILL_HELD, motion.last_sample, (motion.object_label(index),), 1.0, 0.0)


TEXT = {
    "version": 2,
    "objects": [
        {"name": "a", "shape": "box", "size": [0.05, 0.06, 0.08], "position": [-0.3, 0.3], "yaw": 0}
    ],
    "regions": [{"name": "plate", "position": [-0.3, 0.3], "yaw": 0.0, "size": [0.1, 0.1]}],
    "goal": [["off", "a"]],
}


def test_a_scene_with_a_new_fact_is_planned_and_checked() -> None:
    scene = scene_from_json(json.dumps(TEXT))
    assert scene.goal == dvr.Goal((OffRegion("a"),))
    assert scene_from_json(scene_to_json(scene)) == scene

    plan = dvr.plan(scene, search="mbts", termination="feasible", time_limit=1200)
    assert [action.operator for action in plan.actions] == ["grasp", "place"]
    assert plan.actions[-1].arguments[-1] == "table"

    # The measured end state: the box has left the region, although nothing but the fact asked for it.
    assert plan.motion is not None and plan.report is not None and plan.report.passed
    end = plan.motion.qpos[-1, -7:-4]
    assert np.abs(end[:2] - (-0.3, 0.3)).max() > 0.05 and end[2] == pytest.approx(0.04, abs=2e-3)
    cut = plan.motion.switch[-1]
    short = dvr.Motion(plan.motion.time[:cut], plan.motion.qpos[:cut], plan.motion.switch[:1])
    findings = dvr.check(scene, plan.actions[:1], short).findings
    assert "still held" in {finding.kind for finding in findings}
