"""The bounds of the tree say "feasible" only of what is."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from search_cases import judge_prefixes

from dvr_jax.geometry.footprint import Rectangle, inside
from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Variables
from dvr_jax.nlp.transcription import transcribe_switch
from dvr_jax.operators import OPERATORS, object_of
from dvr_jax.planning.feasibility import passes_check
from dvr_jax.scene.sampling import SceneDistribution, scene_of_seed
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import PATH_STARTS
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone
from dvr_jax.seeds.initial_paths import keyframe_start
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, CERTIFIED_PENETRATION
from dvr_jax.solver.lane_pool import solve
from dvr_jax.solver.state import Settings

BOX = SceneObject("a", "box", (0.05, 0.15, 0.1), (-0.2, 0.1), 0.3)


def goal_sequences(region: Region, constants: bool = True) -> list[Node]:
    """All grasps and places of one 5 x 15 cm box onto a region, with their sequence bounds; without `constants`, what
    refutes an action whatever the motion is left to the bounds."""
    with jax.enable_x64(True):
        tree = SequenceTree(Scene((BOX,), OnRegion("a", region)), k_max=2)
        grasps = tree.expand(tree.root)
        if not constants:
            tree._refuted = dict.fromkeys(tree._refuted)
        run_alone(tree.judge_sequences(grasps))
        places = [place for grasp in grasps if grasp.feasible for place in tree.expand(grasp)]
        run_alone(tree.judge_sequences(places))
    return places


def test_a_cylinder_is_grasped_at_one_face_for_all() -> None:
    box = SceneObject("a", "box", (0.05, 0.05, 0.1), (-0.3, 0.3), 0.3)
    can = SceneObject("b", "cylinder", (0.03, 0.1), (-0.3, -0.3), 0.0)
    tree = SequenceTree(
        Scene((box, can), OnRegion("a", Region((-0.1, -0.2), 0.2, (0.1, 0.1)))),
        k_max=3,
        is_relaxed=False,
    )
    grasped = [child.actions[0].arguments[1:] for child in tree.expand(tree.root)]
    assert (
        grasped.count(("+x", "b")) == 2 and len([name for _, name in grasped if name == "b"]) == 2
    )
    assert len([name for _, name in grasped if name == "a"]) == 8


def test_an_object_larger_than_its_region_is_refuted() -> None:
    small = Region((-0.1, -0.2), 0.2, (0.10, 0.10))
    assert goal_sequences(small) == []
    refuted = goal_sequences(small, constants=False)
    assert refuted and not any(place.feasible for place in refuted)


def test_an_object_that_fits_its_region_is_not() -> None:
    assert any(place.feasible for place in goal_sequences(Region((-0.1, -0.2), 0.2, (0.22, 0.22))))


@pytest.mark.parametrize(
    "region", [Region((0.3, -0.45), 0.0, (1.06, 0.4)), Region((-0.3, 0.3), 0.6, (1.1, 0.5))]
)
def test_what_a_candidate_proves_lies_on_a_region_as_large_as_a_table(region: Region) -> None:
    proved = 0
    for place in goal_sequences(region):
        assert place.beam is not None
        for q, m, violation in zip(place.beam.q, place.beam.m, place.beam.violation, strict=True):
            if violation <= CERTIFIED_PENETRATION:
                assert np.isfinite(q[:2]).all()
                footprint = replace(
                    BOX, position=tuple(map(float, m[1, :2])), yaw=float(m[1, 2])
                ).footprint
                grown = Rectangle(
                    region.position,
                    (region.size[0] / 2 + 1e-5, region.size[1] / 2 + 1e-5),
                    region.yaw,
                )
                assert inside(footprint, grown)
                proved += 1
    assert proved


def sampled(index: int) -> Scene:
    """A scene of two boxes; none of them is a small cube, whatever the default."""
    return scene_of_seed(100, index, 2, SceneDistribution(cube_share=0.0))


def judged(scene: Scene, *actions: str) -> tuple[SequenceTree, Node]:
    """A tree and the node of a sequence, with the sequence bounds of its prefixes."""
    tree = SequenceTree(scene, k_max=len(actions))
    return tree, run_alone(judge_prefixes(tree, [Action.parse(action) for action in actions]))


def leaf_of(tree: SequenceTree, *actions: str) -> Node:
    """The node of a sequence, nothing of it judged."""
    node = tree.root
    for text in actions:
        (node,) = [child for child in tree.expand(node) if child.actions[-1] == Action.parse(text)]
    return node


def test_a_second_look_finds_what_the_sequence_bound_missed() -> None:
    scene = sampled(131)
    actions = (
        "grasp(left, -y, yellow)",
        "grasp(right, +y, yellow)",
        "place(right, yellow, goal)",
    )
    with jax.enable_x64(True):
        _, refuted = judged(scene, *actions)
        assert (
            refuted.feasible is False and refuted.refuted_by == "sequence" and refuted.violation > 1
        )
        tree = SequenceTree(scene, k_max=len(actions))
        session = SearchSession(
            tree, lambda leaf, path: passes_check(scene, leaf, path), lambda line: None
        )
        leaf = leaf_of(tree, *actions)
        assert run_alone(session.judge_prefix_chains([leaf])) == [leaf] and not leaf.refuted_by
        assert run_alone(session.try_path(leaf)) is not None


def test_with_nothing_left_out_the_pose_bound_is_the_sequence_bound() -> None:
    actions = "grasp(right, -y, blue)", "place(right, blue, table)", "grasp(right, +y, blue)"
    with jax.enable_x64(True):
        _, expected = judged(sampled(2666), *actions)
        tree = SequenceTree(sampled(2666), k_max=6)
        leaf = leaf_of(tree, *actions)
        for depth in range(1, leaf.depth + 1):
            run_alone(tree.judge_poses([leaf.ancestor(depth)]))
    assert (
        expected.feasible and leaf.feasible and expected.beam is not None and leaf.beam is not None
    )
    for name, theirs in expected.beam._asdict().items():
        np.testing.assert_array_equal(getattr(leaf.beam, name), theirs)


CUBE = Scene(
    (SceneObject("a", "box", (0.028, 0.026, 0.03), (-0.3, 0.1), 0.3),),
    OnRegion("a", Region((0.45, 0.1), 0.0, (0.1, 0.1))),
)
"""A cube that two grippers cannot hold at once, and that the right arm alone can put on its region."""


CANS = scene_of_seed(100, 4, 2, SceneDistribution(shape="cylinder"))


@pytest.mark.parametrize(
    ("scene", "least"), [(sampled(3), 21), (CANS, 6)], ids=["boxes", "cylinders"]
)
def test_what_a_sequence_does_its_last_switch_can_do_alone(scene: Scene, least: int) -> None:
    found = 0
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max=4, is_relaxed=False)
        level = [tree.root]
        for _ in range(3):
            level = [child for node in level for child in tree.expand(node)]
            run_alone(tree.judge_sequences(level))
            level = [node for node in level if node.feasible]
        for node in level:
            assert node.problem is not None and node.beam is not None
            name = object_of(node.actions[-1], OPERATORS)
            earlier = [
                action for action in node.actions[:-1] if object_of(action, OPERATORS) == name
            ]
            if not earlier or earlier[-1].operator == "place":
                continue
            before = earlier[-1]
            others = {object_of(action, OPERATORS) for action in node.actions} - {name}
            problem = transcribe_switch(scene, before, node.actions[-1], sorted(others))
            whole = keyframe_start(node.beam, 0, node.depth)
            held_by = node.problem.mode_action[node.depth - 1, node.problem.switched_object[-1]]
            alone = Variables(np.stack([problem.home, whole.q[-1]]), whole.m[[held_by, -1]])
            assert solve(tree.solver.model, [problem], [alone], Settings())[0].feasible
            found += 1
    assert found >= least, found


def test_a_switch_that_fails_alone_refutes_all_that_end_with_it() -> None:
    # Out of the left arm's reach.
    place = "place(left, a, goal)"
    with jax.enable_x64(True):
        tree = SequenceTree(CUBE, k_max=4, is_relaxed=False)
        first, second = (
            leaf_of(
                tree,
                f"grasp(left, {face}, a)",
                "place(left, a, table)",
                "grasp(left, +y, a)",
                place,
            )
            for face in ("+x", "+y")
        )
        for depth in range(1, 5):
            run_alone(tree.judge_poses([first.ancestor(depth)]))
        assert first.parent is not None and first.parent.feasible and first.refuted_by == "pose"
        run_alone(tree.judge_poses([second.ancestor(1), second.ancestor(2)]))
        run_alone(tree.judge_poses([second.ancestor(3)]))
        before = tree.counts.nlps["pose"], tree.counts.verdicts["pose"]
        assert (
            not tree.check_cached_pose_bound(second)
            and second.refuted_by == "pose"
            and second.violation > 1
        )
    assert (tree.counts.nlps["pose"], tree.counts.verdicts["pose"]) == before


def judge_poses_before(tree: SequenceTree, node: Node) -> None:
    """Pose bounds on the way to a node, without its own."""
    for depth in range(1, node.depth):
        assert run_alone(tree.judge_poses([node.ancestor(depth)])) == [True]


def put_down_and_to_the_goal(tree: SequenceTree, face: str) -> Node:
    return leaf_of(
        tree,
        f"grasp(left, {face}, a)",
        "place(left, a, table)",
        "grasp(right, +y, a)",
        "place(right, a, goal)",
    )


def test_proof_outweighs_a_switch_that_samples_missed() -> None:
    # In reach of both arms.
    scene = replace(CUBE, objects=(replace(CUBE.objects[0], position=(0.0, 0.1)),))
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max=4, is_relaxed=False)
        first, second = (put_down_and_to_the_goal(tree, face) for face in ("+x", "+y"))
        pair = first.actions[-2:]
        tree._pose_bound._switches[pair] = {
            frozenset(): Node(pair, 0, tree.root, False, feasible=False, violation=2.0)
        }
        for leaf in (first, second):
            judge_poses_before(tree, leaf)
        assert not tree.check_cached_pose_bound(first) and first.refuted_by == "pose"
        assert run_alone(tree.judge_poses([leaf_of(tree, *map(str, pair))])) == [True]
        assert tree.check_cached_pose_bound(second) and second.feasible is not False
        assert run_alone(tree.judge_poses([second])) == [True] and second.feasible


def test_a_switch_alone_is_sampled_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    with jax.enable_x64(True):
        tree = SequenceTree(CUBE, k_max=4, is_relaxed=False)
        leaf = put_down_and_to_the_goal(tree, "+x")
        judge_poses_before(tree, leaf)
        isolate_switch = tree.solver.isolate_switch
        seeds: list[int] = []

        def miss_first(node: Node, root: Node, ignored: tuple[str, ...], seed: int) -> None:
            isolate_switch(node, root, ignored, seed)
            seeds.append(seed)
            if len(seeds) == 1:
                # Held 10 m beside the gripper: no arm reaches as far.
                assert node.parent is not None and node.parent.beam is not None
                held = node.parent.beam
                node.parent.beam = held._replace(parameters=held.parameters + 10, m=held.m + 10)

        monkeypatch.setattr(tree.solver, "isolate_switch", miss_first)
        before = tree.counts.nlps["pose"]
        assert run_alone(tree.judge_poses([leaf])) == [True] and leaf.feasible
    assert tree._pose_bound._switches[leaf.actions[-2:]][frozenset()].feasible
    assert seeds == [0, 1] and tree.counts.nlps["pose"] > before


def test_a_switch_alone_leaves_out_what_has_moved_and_nothing_else() -> None:
    there = SceneObject("b", "box", (0.07, 0.07, 0.1), (0.45, 0.1), 0.0)
    scene = replace(CUBE, objects=(*CUBE.objects, there))
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max=6, is_relaxed=False)
        stands = put_down_and_to_the_goal(tree, "+x")
        moved = leaf_of(
            tree,
            "grasp(right, +x, b)",
            "place(right, b, table)",
            *(str(action) for action in stands.actions),
        )
        for leaf, feasible in ((stands, False), (moved, True)):
            judge_poses_before(tree, leaf)
            assert run_alone(tree.judge_poses([leaf])) == [feasible]
    verdicts = {
        left_out: node.feasible
        for left_out, node in tree._pose_bound._switches[stands.actions[-2:]].items()
    }
    assert verdicts == {frozenset(): False, frozenset("b"): True}


def test_switches_alone_refute_nothing_that_the_sequence_bound_finds() -> None:
    with jax.enable_x64(True):
        whole, with_switches = (SequenceTree(CUBE, k_max=5, is_relaxed=False) for _ in range(2))
        levels = [whole.root], [with_switches.root]
        for depth in range(1, 5):
            levels = tuple(  # type: ignore[assignment]
                [child for node in level for child in tree.expand(node)]
                for tree, level in zip((whole, with_switches), levels, strict=True)
            )
            run_alone(whole.judge_sequences(levels[0]))
            run_alone(with_switches.judge_poses(levels[1]))
            found = [{node.actions for node in level if node.feasible} for level in levels]
            assert found[0] == found[1]
            levels = tuple(
                [node for node in level if node.feasible][:: 4 if depth > 1 else 1]
                for level in levels
            )  # type: ignore[assignment]
    verdicts = [
        node.feasible
        for known in with_switches._pose_bound._switches.values()
        for node in known.values()
    ]
    assert verdicts.count(False) > 5 and verdicts.count(True) > 5


def test_a_second_look_leaves_what_is_infeasible_refuted() -> None:
    # In reach, but the other box stands where it should be put.
    there = SceneObject("b", "box", (0.1, 0.1, 0.1), (-0.2, -0.25), 0.0)
    scene = Scene((BOX, there), OnRegion("a", Region((-0.2, -0.25), 0.0, (0.17, 0.17))))
    with jax.enable_x64(True):
        tree, node = judged(scene, "grasp(left, +y, a)", "place(left, a, goal)")
        assert node.parent is not None and node.parent.feasible and node.refuted_by == "sequence"
        before, nlps = tree.counts.feasible["sequence"], tree.counts.nlps["sequence"]
        run_alone(tree.retry_refuted([node]))
    assert tree.counts.nlps["sequence"] == nlps + BEAM_WIDTH
    assert node.feasible is False and (node.refuted_by, tree.counts.feasible["sequence"]) == (
        "sequence",
        before,
    )


def test_a_path_is_tried_from_further_keyframes_too() -> None:
    scene = sampled(2601)
    with jax.enable_x64(True):
        tree, node = judged(scene, "grasp(right, -y, blue)", "place(right, blue, goal)")
        good = tree.solver.path_keyframes(node)
        assert len(good) < PATH_STARTS
        assert not any(
            run_alone(tree.solver.solve_path(node, keyframes)).feasible for keyframes in good
        )
        session = SearchSession(
            tree, lambda leaf, path: passes_check(scene, leaf, path), lambda line: None
        )
        tree.counts.nlps.clear()
        outcome = run_alone(session.try_path(node))
    assert outcome is not None and node.solved and not node.refuted_by
    assert len(good) < tree.counts.nlps["path"] <= PATH_STARTS and tree.counts.nlps["sequence"] > 0
