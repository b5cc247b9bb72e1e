"""Lower bounds on the number of actions: never above what the tree finds, and known by construction in some scenes."""

from collections import Counter

import jax
import mujoco
import numpy as np
import pytest
from relaxation_cases import OUT_OF_REACH, TOO_WIDE, obstructed, single
from search_cases import judge_prefixes

from dvr_jax.logic import Action, count_sequences
from dvr_jax.operators import OPERATORS, ground_scene, object_of
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.object_graph import UNREACHED, ObjectGraph
from dvr_jax.search.reach import REACH_MARGIN, missing_reach, reach_of
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.windows import last_windows
from dvr_jax.search.work import run_alone
from dvr_jax.workcell.panda import PANDA

EASY = single((0.05, 0.05, 0.05), (-0.4, 0.35))


def lower_bound(scene: Scene, limit: int) -> tuple[int, SequenceTree]:
    with jax.enable_x64(True):
        tree = SequenceTree(scene, limit)
        run_alone(tree.judge_scene())
    return tree.relaxation.lower_bound, tree


def test_no_posture_reaches_farther_than_the_reach() -> None:
    data = mujoco.MjData(PANDA.model)
    generator = np.random.default_rng(0)
    low, high = PANDA.joint_limits
    gripper = PANDA.model.body("link7").id
    shoulder = PANDA.model.body("link1").id
    farthest = 0.0
    for _ in range(3000):
        data.qpos[: len(low)] = generator.uniform(low, high)
        mujoco.mj_kinematics(PANDA.model, data)
        rotation = data.xmat[gripper].reshape(3, 3)
        center = data.xpos[gripper] + rotation @ PANDA.gripper_center
        farthest = max(farthest, float(np.linalg.norm(center - data.xpos[shoulder])))
    assert farthest <= reach_of(PANDA) - REACH_MARGIN + 1e-9
    # Random postures come close to the largest distance, so the reach is no loose bound.
    assert farthest > reach_of(PANDA) - 0.06


def test_walks_of_one_object_are_its_sequences() -> None:
    graph = ObjectGraph(EASY, "cube", OPERATORS, lambda action: True)
    walks = Counter({graph.root: 1})
    counted = {}
    for length in range(1, 6):
        after: Counter[object] = Counter()
        for vertex, number in walks.items():
            for edge in graph.edges_from[vertex]:  # type: ignore[index]
                after[edge.after] += number
        counted[length] = sum(number for vertex, number in after.items() if vertex in graph.goals)
        walks = after  # type: ignore[assignment]
    assert counted == count_sequences(ground_scene(EASY), 5)


def test_distances_are_those_of_the_logic() -> None:
    graph = ObjectGraph(EASY, "cube", OPERATORS, lambda action: True)
    grounding = ground_scene(EASY)
    distance = graph.distances_to_goal(lambda edge: True)
    for (state, _), least in distance.items():
        assert grounding.reaches_goal_in(state, least)
        assert not any(grounding.reaches_goal_in(state, k) for k in range(least))


def test_an_arm_that_must_act_last_can_make_the_way_longer() -> None:
    graph = ObjectGraph(EASY, "cube", OPERATORS, lambda action: True)
    after_left = graph.vertex_after([Action.parse("grasp(left, +x, cube)")])
    assert after_left is not None
    assert graph.distances_to_goal(lambda edge: True, "left")[after_left] == 1
    assert graph.distances_to_goal(lambda edge: True, "right")[after_left] == 2


def test_windows_are_the_last_actions_on_one_object() -> None:
    texts = ("grasp(left, +x, a)", "grasp(right, +x, b)", "place(left, a, table)")
    actions = [Action.parse(text) for text in texts]
    assert last_windows(actions[:1], OPERATORS) == ((None, actions[0]), None)
    assert last_windows(actions, OPERATORS) == (
        (actions[0], actions[2]),
        (None, actions[0], actions[2]),
    )
    assert last_windows(actions, OPERATORS, "b") == ((None, actions[1]), None)


@pytest.mark.parametrize("scene", [OUT_OF_REACH, TOO_WIDE], ids=["out of reach", "too wide"])
def test_constants_refute_a_scene_without_any_nlp(scene: Scene) -> None:
    least, tree = lower_bound(scene, 6)
    assert least == UNREACHED and tree.relaxation.is_hopeless()
    assert not tree.counts.nlps and not tree.counts.verdicts["window"]


def test_the_missing_reach_shrinks_as_the_target_comes_nearer() -> None:
    window = (Action.parse("grasp(left, +x, cube)"), Action.parse("place(left, cube, goal)"))
    far, near = (
        missing_reach(single((0.05, 0.05, 0.05), (0.0, y), 0.1), window, OPERATORS)
        for y in (0.85, 0.8)
    )
    assert far > near
    # The target comes nearer to the base by 5 cm times the cosine of its direction.
    assert far - near == pytest.approx(0.05 * 0.85 / np.hypot(0.75, 0.85), abs=0.005)


def test_one_grasp_and_one_place_are_the_least() -> None:
    least, tree = lower_bound(EASY, 4)
    assert least == 2
    grasp = Action.parse("grasp(left, +x, cube)")
    assert tree.relaxation.remaining([grasp]) == 1
    put_down = [grasp, Action.parse("place(left, cube, table)")]
    assert tree.relaxation.remaining(put_down) == 2


def test_a_box_on_the_target_costs_two_more_actions() -> None:
    least, tree = lower_bound(obstructed(1), 6)
    assert least == 4 and tree.relaxation.required == {"b1"}
    # Once it is in a hand, nothing is known of where it goes.
    assert tree.relaxation.remaining([Action.parse("grasp(left, +x, b1)")]) == 2


def test_prefixes_that_need_too_many_further_actions_are_not_expanded() -> None:
    least, tree = lower_bound(obstructed(1), 3)
    assert least == 4
    # A grasp of the target box leaves two actions, of which none moves the other box.
    first = [child.actions[0] for child in tree.expand(tree.root)]
    assert first and {object_of(action, OPERATORS) for action in first} == {"b1"}


def test_a_node_is_refuted_by_a_window_and_says_so() -> None:
    with jax.enable_x64(True):
        tree = SequenceTree(OUT_OF_REACH, 2)
        texts = ("grasp(left, +x, cube)", "place(left, cube, goal)")
        leaf = run_alone(judge_prefixes(tree, [Action.parse(texts[0])]))
        child = Node((*leaf.actions, Action.parse(texts[1])), 0, leaf, reaches_goal=True)
        assert run_alone(tree.judge_windows([child])) == [False]
    assert child.feasible is False and child.refuted_by == "pose"


@pytest.mark.parametrize("index", [3, 10])
def test_no_window_of_a_feasible_sequence_is_refuted(index: int) -> None:
    scene = scene_of_seed(6, index, 2)
    with jax.enable_x64(True):
        whole = SequenceTree(scene, 4, is_relaxed=False)
        level = [whole.root]
        feasible: list[Node] = []
        for _ in range(2):
            level = [child for node in level for child in whole.expand(node)]
            run_alone(whole.judge_sequences(level))
            level = [node for node in level if node.feasible]
            feasible += level
        tree = SequenceTree(scene, 4, seed=1)
        copies = [Node(node.actions, 0, tree.root, node.reaches_goal) for node in feasible]
        assert len(copies) > 20 and all(run_alone(tree.judge_windows(copies)))
    assert {object_of(node.actions[-1], OPERATORS) for node in feasible} == set(scene.object_names)
