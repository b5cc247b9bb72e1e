"""What touches or is near in a state, and what touches between two, against MuJoCo's distance of one pair of geoms."""

from dataclasses import replace
from itertools import combinations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from other_robots import LONG_PANDA, SIX_JOINTS
from puppet import Case, layout_of

from dvr_jax.checker import motion_contacts
from dvr_jax.checker.all_poses import all_poses
from dvr_jax.checker.collision_model import CollisionModel, collision_model, solid_geoms
from dvr_jax.checker.contacts import Contacts, contacts_of
from dvr_jax.checker.contacts_at_states import SAME_PLACE, contacts_at_states
from dvr_jax.checker.dense_states import LARGEST_TURN, dense_states
from dvr_jax.checker.geom_poses import farthest_move
from dvr_jax.checker.motion_contacts import STEP_LENGTH, find_contacts
from dvr_jax.checker.pair_distances import PairsInStates, least_distances, pair_distances
from dvr_jax.checker.tolerances import DEEPEST_CONTACT
from dvr_jax.motion import make_motion
from dvr_jax.scene.mjcf import COLLISION_GROUP, SOLID_GROUP, build_model, home_qpos
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import Robot
from dvr_jax.workcell.workcell import Arm, Workcell

Floats = NDArray[np.float64]


def crowded_scene() -> Scene:
    """Two boxes and two cylinders."""
    return Scene(
        (
            SceneObject("brick", "box", (0.05, 0.08, 0.10), (-0.20, 0.20), 0.3),
            SceneObject("wall", "box", (0.30, 0.02, 0.20), (0.0, 0.0), 0.0),
            SceneObject("can", "cylinder", (0.03, 0.12), (0.25, 0.25), 0.0),
            SceneObject("disc", "cylinder", (0.06, 0.03), (0.25, -0.25), 0.0),
        ),
        OnRegion("brick", Region((-0.15, -0.30), 0.2, (0.14, 0.14))),
    )


def crowded_states(number: int, seed: int) -> Floats:
    """Random postures; the objects are in a heap somewhere before the left arm, the first one at its hand."""
    generator = np.random.default_rng(seed)
    scene, layout = crowded_scene(), layout_of(4)
    model = build_model(scene)
    data = mujoco.MjData(model)
    states = np.tile(home_qpos(scene), (number, 1))
    for qpos in states:
        qpos[layout.arm_joints] += generator.normal(0.0, 0.3, (2, 7))
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        hand = data.site("left/gripper").xpos
        for n, columns in enumerate(layout.objects):
            around = hand if n % 2 == 0 else data.xpos[model.body("left/link6").id]
            turn = generator.normal(size=4) if n else np.array([1.0, 0.0, 0.0, generator.normal()])
            qpos[columns] = [
                *(around + generator.uniform(-0.12, 0.12, 3)),
                *(turn / np.linalg.norm(turn)),
            ]
    return states


def independent_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Pairs of solid geoms that move independently of each other."""
    solid = np.flatnonzero(np.isin(model.geom_group, (SOLID_GROUP, COLLISION_GROUP)))
    fixed = model.body_weldid[model.geom_bodyid] == 0
    name = {geom: model.body(model.geom_bodyid[geom]).name for geom in solid.tolist()}
    # An object's body is named after the object, an arm's links after the arm.
    mover = {
        geom: body if body.startswith("object/") else body.split("/")[0]
        for geom, body in name.items()
    }
    return [
        (a, b)
        for a, b in combinations(mover, 2)
        if mover[a] != mover[b] and not (fixed[a] and fixed[b])
    ]


def distances(model: mujoco.MjModel, qpos: Floats, farthest: float) -> dict[tuple[int, int], float]:
    """Of all independent pairs, one by one."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return {
        pair: mujoco.mj_geomDistance(model, data, *pair, farthest, None)
        for pair in independent_pairs(model)
    }


def case_states(name: str, request: pytest.FixtureRequest) -> tuple[Scene, Floats]:
    if name == "crowded":
        return crowded_scene(), crowded_states(60, 0)
    case: Case = request.getfixturevalue(name)
    return case.scene, case.motion.qpos[::2]


@pytest.mark.parametrize("name", ["carry", "handover", "crowded"])
def test_what_is_nearer_than_its_margins_is_found(
    name: str, request: pytest.FixtureRequest
) -> None:
    scene, states = case_states(name, request)
    scene_model = collision_model(scene)
    model = scene_model.model
    margins = np.random.default_rng(0).uniform(0.0, 0.03, (len(states), model.ngeom))
    found = contacts_of(scene_model, states, all_poses(scene_model, states).geoms, margins)
    told: dict[tuple[int, int, int], float] = {}
    for state, distance, geoms in zip(found.state, found.distance, found.geoms, strict=True):
        key = (int(state), *sorted(geoms.tolist()))
        told[key] = min(distance, told.get(key, np.inf))

    near = deep = 0
    for state, qpos in enumerate(states):
        for (first, second), distance in distances(model, qpos, 1.0).items():
            margin = margins[state, first] + margins[state, second]
            if abs(distance - margin) > 1e-5:
                assert ((state, first, second) in told) == (distance < margin)
            if -0.01 < distance < margin - 1e-5:
                near, deep = near + 1, deep + (distance < -0.001)
                assert told[state, first, second] == pytest.approx(distance, abs=1e-4)
    assert near > 100 and (deep > 50 or name != "crowded")


@pytest.mark.parametrize("turn", [0.03, 0.15, 0.5])
def test_what_penetrates_between_two_samples_is_found(turn: float) -> None:
    """Against many states in between: less deep by half of `STEP_LENGTH` at most."""
    generator = np.random.default_rng(1)
    scene_model = collision_model(crowded_scene())
    model = scene_model.model
    layout = layout_of(4)
    hits = 0
    for start in crowded_states(50, 1):
        end = start.copy()
        end[layout.arm_joints] += generator.uniform(-turn, turn, (2, 7))
        for columns in layout.objects[1:]:
            end[columns[:3]] += generator.uniform(-turn, turn, 3) / 3
        states, _ = dense_states(model, make_motion([0.0, 0.1], [start, end], [1]))
        found = contacts_found(scene_model, states)
        deepest: dict[tuple[int, ...], float] = {}
        for distance, geoms in zip(found.distance, found.geoms, strict=True):
            key = tuple(sorted(geoms.tolist()))
            deepest[key] = min(distance, deepest.get(key, np.inf))
        truth: dict[tuple[int, ...], float] = {}
        at_ends = [distances(model, qpos, 0.0) for qpos in (start, end)]
        for share in np.linspace(0.0, 1.0, 40):
            for pair, distance in distances(model, start + share * (end - start), 0.0).items():
                truth[pair] = min(distance, truth.get(pair, np.inf))
        for pair, distance in truth.items():
            # Depths of more than some centimeters are those of a local minimum.
            if -0.02 < distance < -STEP_LENGTH:
                hits += distance < min(ends[pair] for ends in at_ends) - STEP_LENGTH / 2
                assert deepest[pair] < distance + STEP_LENGTH / 2 + 2e-4, (pair, distance)
    assert hits > 8 or turn < 0.1


def accepted_depths(model: mujoco.MjModel) -> Floats:
    """The same of any two geoms."""
    return np.full((model.ngeom, model.ngeom), DEEPEST_CONTACT)


def contacts_found(scene_model: CollisionModel, states: Floats) -> Contacts:
    """All contacts in some states and between them."""
    poses = all_poses(scene_model, states).geoms
    return find_contacts(scene_model, states, poses, accepted_depths(scene_model.model))


def by_pair(contacts: Contacts) -> dict[tuple[int, int, int], float]:
    """Least distance of each pair in each state."""
    least: dict[tuple[int, int, int], float] = {}
    for state, distance, geoms in zip(
        contacts.state.tolist(), contacts.distance.tolist(), contacts.geoms.tolist(), strict=True
    ):
        key = (state, min(geoms), max(geoms))
        least[key] = min(distance, least.get(key, np.inf))
    return least


def pairs_looked_at(
    scene_model: CollisionModel, states: Floats, monkeypatch: pytest.MonkeyPatch
) -> int:
    """Number of pairs whose distances are computed between the states."""
    looked: list[int] = []

    def count(model: CollisionModel, poses: object, pairs: PairsInStates) -> Floats:
        looked.append(len(pairs.state))
        return pair_distances(model, poses, pairs)  # type: ignore[arg-type]

    monkeypatch.setattr(motion_contacts, "pair_distances", count)
    contacts_found(scene_model, states)
    return looked[0]


def test_what_moves_together_is_not_looked_at_in_between(
    carry: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm's links and what it carries, twice as fast; but the box is looked at where it moves in the hand."""
    grasp, place = carry.motion.switch
    states = carry.motion.qpos[grasp + 20 : place - 20 : 2].copy()
    scene_model = collision_model(carry.scene)
    assert pairs_looked_at(scene_model, states, monkeypatch) < 20

    box = layout_of(2).objects[0]
    states[::2, box[2]] += 0.01
    assert pairs_looked_at(scene_model, states, monkeypatch) > 200


def smooth_crowded_states(number: int, turn: float) -> Floats:
    """A crowded motion that starts slowly, rests for a while, and ends fast."""
    ends = crowded_states(2, 3)
    share = np.linspace(0.0, 1.0, number)[:, None] ** 2
    states = ends[:1] + turn * share * (ends[1:] - ends[:1])
    states[number // 3 : number // 2] = states[number // 3]
    columns = layout_of(4).objects[:, 3:]
    states[:, columns] /= np.linalg.norm(states[:, columns], axis=-1, keepdims=True)
    return states


@pytest.mark.parametrize("name", ["carry", "carry_fast", "handover", "crowded", "smooth"])
def test_no_pair_is_skipped_that_is_near(name: str, request: pytest.FixtureRequest) -> None:
    """Against the collision detection in every state, with the same margins."""
    if name == "smooth":
        scene, states = crowded_scene(), smooth_crowded_states(150, 1.0)
    elif name == "carry_fast":
        scene, states = case_states("carry", request)
        states = states[::8]
    else:
        scene, states = case_states(name, request)
    scene_model = collision_model(scene)
    model = scene_model.model
    poses = all_poses(scene_model, states).geoms
    shift = np.diff(poses.positions, axis=0)
    reach = farthest_move(shift, np.diff(poses.rotations, axis=0), model.geom_rbound)
    padded = np.pad(reach, ((1, 1), (0, 0)))
    margins = np.maximum(padded[:-1], padded[1:]) / 2

    expected = by_pair(contacts_of(scene_model, states, poses, margins))
    found = by_pair(contacts_at_states(scene_model, states, poses, reach, accepted_depths(model)))
    assert len(expected) > 100
    for key in expected.keys() ^ found.keys():
        state, first, second = key
        limit = margins[state, first] + margins[state, second]
        assert abs({**expected, **found}[key] - limit) < 1e-9, key
    for key in expected.keys() & found.keys():
        assert found[key] == pytest.approx(expected[key], abs=2 * SAME_PLACE), key


@pytest.mark.parametrize("robot", [PANDA, SIX_JOINTS, LONG_PANDA], ids=lambda robot: robot.name)
def test_the_model_has_all_that_collides(robot: Robot) -> None:
    """Robots with inertias, and one whose inertias follow from its looks."""
    workcell = Workcell((Arm("arm", (0.0, -0.4), 0.0, robot.home),), robot)
    scene = replace(crowded_scene(), workcell=workcell)
    model = build_model(scene)
    small = collision_model(scene).model
    solid = np.flatnonzero(solid_geoms(model))
    assert solid_geoms(small).all() and small.ngeom == len(solid) < model.ngeom
    for name in ("type", "size", "pos", "quat", "bodyid", "rbound"):
        expected = getattr(model, f"geom_{name}")[solid]
        np.testing.assert_array_equal(getattr(small, f"geom_{name}"), expected, err_msg=name)
    for name in ("body_pos", "body_quat", "body_parentid", "jnt_qposadr", "site_pos"):
        np.testing.assert_array_equal(getattr(small, name), getattr(model, name), err_msg=name)
    np.testing.assert_array_equal(small.exclude_signature, model.exclude_signature)


def test_bounds_are_below_the_distances() -> None:
    """Of all pairs in a crowd; most bounds are useful, and none exceeds the distance."""
    scene_model = collision_model(crowded_scene())
    states = crowded_states(20, 2)
    poses = all_poses(scene_model, states).geoms
    first, second = np.array(independent_pairs(scene_model.model)).T
    bounds = least_distances(scene_model.model, poses, first, second)
    state = np.repeat(np.arange(len(states)), len(first))
    pairs = PairsInStates(
        state, np.tile(first, len(states)), np.tile(second, len(states)), np.full(len(state), 10.0)
    )
    exact = pair_distances(scene_model, poses, pairs).reshape(bounds.shape)
    apart = exact > 0
    assert (bounds[apart] <= exact[apart] + 1e-6).all()
    assert (bounds[~apart] <= 1e-6).all()
    assert np.median(exact[apart] - bounds[apart]) < 0.15


@pytest.mark.parametrize("every", [1, 3, 40])
def test_a_fast_thin_body_is_not_missed(carry: Case, every: int) -> None:
    """A rod of 4 mm flies through the forearm and back while the arm rests: it touches at no sample."""
    scene = carry.scene
    rod = SceneObject("can", "cylinder", (0.002, 0.3), scene.objects[1].position, 0.0)
    scene = replace(scene, objects=(scene.objects[0], rod))
    scene_model = collision_model(scene)
    model = scene_model.model
    columns = layout_of(2).objects[1]
    home = carry.motion.qpos[0].copy()
    center = all_poses(scene_model, home[None]).geoms.positions[0]
    forearm = model.geom("left/forearm_collision").id

    # Slow motion far away, a step of 0.6 m through the arm, and slow motion on the other side.
    side = np.concatenate([np.linspace(-0.301, -0.3, 40), np.linspace(0.3, 0.301, 40)])[::every]
    states = np.tile(home, (len(side), 1))
    states[:, columns] = [*center[forearm], 1.0, 0.0, 0.0, 0.0]
    states[:, columns[1]] += side
    alone = contacts_of(
        scene_model,
        states,
        all_poses(scene_model, states).geoms,
        np.zeros((len(states), model.ngeom)),
    )
    is_rod = np.array([label == "object/can" for label in scene_model.labels])
    assert not is_rod[alone.geoms].any()

    found = contacts_found(scene_model, states)
    deep = found.distance < -DEEPEST_CONTACT
    touched = {
        scene_model.labels[geom] for pair in found.geoms[deep] for geom in pair if not is_rod[geom]
    }
    assert "left/link5" in touched
    assert set(found.state[deep & is_rod[found.geoms].any(axis=1)].tolist()) == {
        int(np.flatnonzero(side > 0)[0])
    }


def test_large_turns_are_divided(carry: Case) -> None:
    qpos = carry.motion.qpos[[0, 0, 0]].copy()
    qpos[1:, 0] += [0.1, 0.1 + 4.5 * LARGEST_TURN]
    states, sample = dense_states(build_model(carry.scene), make_motion([0.0, 1.0, 2.0], qpos, [1]))
    assert sample.tolist() == [0, 1, 2, 2, 2, 2, 2]
    np.testing.assert_allclose(np.diff(states[:, 0]), [0.1, *[0.9 * LARGEST_TURN] * 5])
