"""What touches or is near in a state, and what touches between two, against MuJoCo's distance of one pair of geoms."""

import copy
from itertools import combinations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from puppet import Case, layout_of

from dvr_jax.checker import motion_contacts
from dvr_jax.checker.contacts import Contacts, contacts_of
from dvr_jax.checker.dense_states import LARGEST_TURN, dense_states
from dvr_jax.checker.motion_contacts import STEP_LENGTH, GeomPoses, find_contacts
from dvr_jax.motion import make_motion
from dvr_jax.scene.mjcf import COLLISION_GROUP, SOLID_GROUP, build_model, home_qpos
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject

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
    model = copy.copy(build_model(scene))
    margins = np.random.default_rng(0).uniform(0.0, 0.03, (len(states), model.ngeom))
    found = contacts_of(model, states, margins)
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
    model = copy.copy(build_model(crowded_scene()))
    layout = layout_of(4)
    hits = 0
    for start in crowded_states(50, 1):
        end = start.copy()
        end[layout.arm_joints] += generator.uniform(-turn, turn, (2, 7))
        for columns in layout.objects[1:]:
            end[columns[:3]] += generator.uniform(-turn, turn, 3) / 3
        states, _ = dense_states(model, make_motion([0.0, 0.1], [start, end], [1]))
        found = find_contacts(model, states, geom_poses(model, states))
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


def geom_poses(model: mujoco.MjModel, states: Floats) -> GeomPoses:
    """Positions and rotations of all geoms."""
    data = mujoco.MjData(model)
    poses = []
    for qpos in states:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        poses.append((data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()))
    positions, rotations = zip(*poses, strict=True)
    return GeomPoses(np.array(positions), np.array(rotations))


def test_what_moves_together_is_not_looked_at_in_between(
    carry: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm's links and what it carries, twice as fast."""
    looked: list[int] = []

    def count(model: mujoco.MjModel, states: Floats, margins: Floats) -> Contacts:
        looked.append(len(states))
        return contacts_of(model, states, margins)

    monkeypatch.setattr(motion_contacts, "contacts_of", count)
    grasp, place = carry.motion.switch
    states = carry.motion.qpos[grasp + 20 : place - 20 : 2]
    model = copy.copy(build_model(carry.scene))
    find_contacts(model, states, geom_poses(model, states))
    assert looked[0] == len(states) and looked[1] < 10


def test_large_turns_are_divided(carry: Case) -> None:
    qpos = carry.motion.qpos[[0, 0, 0]].copy()
    qpos[1:, 0] += [0.1, 0.1 + 4.5 * LARGEST_TURN]
    states, sample = dense_states(build_model(carry.scene), make_motion([0.0, 1.0, 2.0], qpos, [1]))
    assert sample.tolist() == [0, 1, 2, 2, 2, 2, 2]
    np.testing.assert_allclose(np.diff(states[:, 0]), [0.1, *[0.9 * LARGEST_TURN] * 5])
