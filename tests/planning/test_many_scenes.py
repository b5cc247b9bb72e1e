"""Many scenes: the plans of `plan`, one for each scene, whatever becomes of the others."""

from dataclasses import replace

import numpy as np
import pytest

from dvr_jax.errors import OptionError
from dvr_jax.planning.many_scenes import plan_scenes, run_scene_tasks
from dvr_jax.planning.planner import plan
from dvr_jax.planning.scene_tasks import PlanSettings, SceneTask
from dvr_jax.scene.files import OnRegion, Region, SceneObject, make_scene

NEAR = make_scene(
    [SceneObject("tile", "box", (0.05, 0.05, 0.08), (-0.35, 0.2), 0.2)],
    OnRegion("tile", Region((-0.35, -0.2), 0.0, (0.12, 0.12))),
)
"""One arm does it alone."""

TOO_WIDE = make_scene(
    [SceneObject("tile", "box", (0.15, 0.15, 0.08), (-0.35, 0.2), 0.2)],
    OnRegion("tile", Region((-0.35, -0.2), 0.0, (0.25, 0.25))),
)
"""No gripper can hold it."""


def test_the_plans_are_those_of_one_scene_at_a_time() -> None:
    moved = replace(NEAR.objects[0], position=(-0.33, 0.22))
    scenes = [NEAR, TOO_WIDE, replace(NEAR, objects=(moved,))]
    found = {result.index: result for result in plan_scenes(scenes, k_max=2, workers=2)}
    assert sorted(found) == [0, 1, 2] and not any(result.failure for result in found.values())
    assert [found[index].solved for index in range(3)] == [True, False, True]

    for index, scene in enumerate(scenes):
        alone = plan(scene, k_max=2)
        together = found[index].plan
        assert together is not None
        assert (together.status, together.actions) == (alone.status, alone.actions)
        assert (together.nlps, together.verdicts) == (alone.nlps, alone.verdicts)
        if alone.motion is not None:
            assert together.motion is not None
            np.testing.assert_array_equal(together.motion.qpos, alone.motion.qpos)


def test_a_refused_scene_and_a_defect_do_not_end_the_others() -> None:
    posture = NEAR.workcell.arms[0].home
    bent = replace(NEAR.workcell.arms[0], home=(posture[0], 1.7, *posture[2:]))
    in_table = replace(NEAR, workcell=replace(NEAR.workcell, arms=(bent, NEAR.workcell.arms[1])))
    settings = PlanSettings(k_max=1)
    tasks = [
        SceneTask(3, in_table, settings),
        SceneTask(4, None, settings),  # type: ignore[arg-type]
        SceneTask(5, NEAR, settings),
    ]
    found = {result.index: result for result in run_scene_tasks(tasks, workers=2)}
    assert found[3].is_refused and "penetrate" in found[3].failure
    assert found[4].is_refused and "valid is a Scene" in found[4].failure
    assert found[5].plan is not None and not found[5].solved


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"search": "best"}, "there is no search 'best'"),
        ({"k_max": 0}, "k_max is 0"),
        ({"workers": 0}, "the number of workers is 0"),
        ({"termination": "soon"}, "the termination is the text 'soon'"),
        ({"clearance": 9}, "the clearance is 9"),
        ({"search": "mbts", "network": "network.npz"}, "takes no network"),
    ],
)
def test_bad_arguments_are_refused_before_a_worker_starts(
    arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        plan_scenes([NEAR], **arguments)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match=r"the scene is the path 'scene\.json'"):
        plan_scenes(["scene.json"])  # type: ignore[list-item]
