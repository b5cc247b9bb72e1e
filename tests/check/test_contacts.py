"""What touches or is near at a sample, against MuJoCo's distance of one pair of geoms."""

import copy
from itertools import combinations

import mujoco
import numpy as np
import pytest
from wrong_motions import Case

from dvr_jax.check.contacts import contacts_of
from dvr_jax.scene.mjcf import COLLISION_GROUP, SOLID_GROUP, build_model


def independent_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Pairs of solid geoms that move independently of each other."""
    solid = np.flatnonzero(np.isin(model.geom_group, (SOLID_GROUP, COLLISION_GROUP)))
    fixed = model.body_weldid[model.geom_bodyid] == 0
    name = {geom: model.body(model.geom_bodyid[geom]).name for geom in solid.tolist()}
    # An object's body is named after the object, an arm's links after the arm.
    mover = {geom: body if body.startswith("object/") else body.split("/")[0] for geom, body in name.items()}
    return [(a, b) for a, b in combinations(mover, 2) if mover[a] != mover[b] and not (fixed[a] and fixed[b])]


@pytest.mark.parametrize("name", ["carry", "handover"])
def test_what_is_nearer_than_its_margins_is_found(name: str, request: pytest.FixtureRequest) -> None:
    case: Case = request.getfixturevalue(name)
    model = copy.copy(build_model(case.scene))
    states = case.motion.qpos[::2]
    margins = np.random.default_rng(0).uniform(0.0, 0.03, (len(states), model.ngeom))
    found = contacts_of(model, states, np.arange(len(states)), margins)
    told: dict[tuple[int, int, int], float] = {}
    for sample, distance, geoms in zip(found.sample, found.distance, found.geoms, strict=True):
        key = (int(sample), *sorted(geoms.tolist()))
        told[key] = min(distance, told.get(key, np.inf))

    data, near = mujoco.MjData(model), 0
    for sample, qpos in enumerate(states):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        for first, second in independent_pairs(model):
            margin = margins[sample, first] + margins[sample, second]
            distance = mujoco.mj_geomDistance(model, data, first, second, 1.0, None)
            if abs(distance - margin) > 1e-5:
                assert ((sample, first, second) in told) == (distance < margin)
            if 0 < distance < margin - 1e-5:
                near += 1
                assert told[sample, first, second] == pytest.approx(distance, abs=1e-5)
    assert near > 100
