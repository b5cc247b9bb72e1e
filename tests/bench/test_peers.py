"""Our problems as problems of `robotic`: the same poses, and the same verdict on an easy problem."""

import importlib

import mujoco
import numpy as np
import pytest

from dvr_jax.bench.peer_judging import judge_point
from dvr_jax.bench.peers import PeersOptions, draw_sequence, run
from dvr_jax.bench.rai import build_keyframes, build_path, solve_peer, to_variables
from dvr_jax.bench.rai_scene import build_peer_scene, gripper_frame, load_robotic, object_frame
from dvr_jax.bench.recall import judge_prefix
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, ground_scene, refute
from dvr_jax.scene.mjcf import build_model, home_qpos, object_body_name, qpos_layout
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.initial_paths import STEPS_PER_PHASE
from dvr_jax.workcell.model import workcell_model

try:
    load_robotic()
    MISSING = ""
except DvrError as error:
    MISSING = str(error)
with_robotic = pytest.mark.skipif(bool(MISSING), reason=MISSING or "robotic is there")

EASY = [Action("grasp", ("left", "+x", "near")), Action("place", ("left", "near", "goal"))]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A narrow box in front of the left arm, its goal beside it, and a box elsewhere."""
    near = SceneObject("near", "box", (0.05, 0.08, 0.10), (-0.30, 0.15), 0.4)
    far = SceneObject("far", "box", (0.06, 0.12, 0.08), (0.40, 0.30), -1.0)
    goal = OnRegion("near", Region((-0.30, -0.20), 0.3, (0.14, 0.14)))
    return make_scene((near, far), goal).with_clearance(0.0)


@with_robotic
def test_grippers_and_objects_are_where_mujoco_has_them(scene: Scene) -> None:
    peer, model = build_peer_scene(scene), build_model(scene)
    data = mujoco.MjData(model)
    home = np.array(scene.home).reshape(-1)
    for q in (home, home + np.random.default_rng(0).normal(size=14) * 0.3):
        data.qpos[:] = home_qpos(scene)
        data.qpos[qpos_layout(scene).arm_joints.reshape(-1)] = q
        mujoco.mj_kinematics(model, data)
        peer.config.setJointState(q)
        expected = [data.site(f"{arm}/gripper") for arm in scene.workcell.arm_names]
        expected += [data.body(object_body_name(item.name)) for item in scene.objects]
        names = [*map(gripper_frame, range(2)), *map(object_frame, range(2))]
        for name, there in zip(names, expected, strict=True):
            frame = peer.config.getFrame(name)
            assert np.allclose(frame.getPosition(), there.xpos, atol=1e-9)
            assert np.allclose(frame.getRotationMatrix(), there.xmat.reshape(3, 3), atol=1e-9)


@with_robotic
def test_home_is_free_of_collisions(scene: Scene) -> None:
    peer = build_peer_scene(scene)
    peer.config.computeCollisions()
    assert peer.config.getCollisions(0.0) == []


@with_robotic
def test_an_easy_problem_is_feasible_in_both(scene: Scene) -> None:
    assert run_alone(judge_prefix(SequenceTree(scene, k_max=2), EASY)).feasible
    peer = build_peer_scene(scene)
    keyframes = solve_peer(peer, build_keyframes(peer, EASY), seed=0)
    assert keyframes.feasible
    problem = transcribe(scene, EASY)
    model = workcell_model(scene.workcell)
    assert judge_point(model, problem, to_variables(problem, EASY, keyframes))["ratio"] <= 1
    path = solve_peer(peer, build_path(peer, EASY, keyframes, STEPS_PER_PHASE), seed=0)
    assert path.feasible
    assert path.q.shape == (2 * STEPS_PER_PHASE, 14)


def test_drawn_sequences_reach_the_goal_and_are_not_refuted(scene: Scene) -> None:
    grounding = ground_scene(scene)
    generator = np.random.default_rng(0)
    for length in range(2, 7):
        actions = draw_sequence(grounding, scene, length, generator)
        assert actions is not None
        grounding.check_sequence(actions)
        assert all(refute(scene, action, OPERATORS) is None for action in actions)


def test_without_robotic_a_sentence_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> None:
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(importlib, "import_module", fail)
    with pytest.raises(DvrError, match=r"\.\[peers\].*liblapack3"):
        load_robotic.__wrapped__()


def test_no_scenes_are_refused() -> None:
    with pytest.raises(DvrError, match="number of scenes is 0"):
        run(["--number", "0"])
    assert PeersOptions().number > 0
