"""Forward kinematics, capsules and joint screws against MuJoCo C and MJX, in every workcell."""

from collections.abc import Iterator
from copy import copy

import jax
import mujoco
import numpy as np
import pytest
from arm_states import (
    POSTURES,
    Floats,
    Simulated,
    as_arms,
    bases_of,
    matrices,
    sample_postures,
    vectors,
)
from mujoco import mjx

from dvr_jax.runtime.compilation import CPU_OPTIONS
from dvr_jax.workcell.gripper_motion import shift_gripper
from dvr_jax.workcell.kinematics import (
    BasePoses,
    capsule_segments,
    hand_pose,
    joint_screws,
    link_poses,
)
from dvr_jax.workcell.model import WorkcellModel, workcell_model
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import WORKCELLS, Workcell, base_positions, base_rotations

TIGHT = {"rtol": 0, "atol": 1e-12}
CAPSULE_NAMES = tuple(f"{name}_collision" for name in PANDA.capsules.names)


def forward_quantities(
    model: WorkcellModel, bases: BasePoses, q: Floats, openings: Floats
) -> tuple[object, ...]:
    links = link_poses(model, bases, q)
    return (
        links,
        hand_pose(model, links),
        capsule_segments(model, links, openings),
        joint_screws(links),
    )


COMPILED = jax.jit(forward_quantities, compiler_options=CPU_OPTIONS)


class Forward:
    """All forward quantities of the sampled postures of a workcell."""

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.simulated = Simulated(workcell)
        self.q, self.openings = sample_postures(workcell=workcell)
        links, hand, capsules, screws = COMPILED(
            workcell_model(workcell), bases_of(workcell, POSTURES), as_arms(self.q), self.openings.T
        )
        self.link_rotations = np.stack([matrices(R) for R in links.rotations])  # [8, A, n, 3, 3]
        self.link_positions = np.stack([vectors(p) for p in links.positions])  # [8, A, n, 3]
        self.hand_rotations, self.hand_positions = (
            matrices(hand[0]),
            vectors(hand[1]),
        )  # [A, n, ...]
        self.starts, self.ends = vectors(capsules[0]), vectors(capsules[1])  # [A, C, n, 3]
        self.screws = np.asarray(screws)  # [6, A, J, n]

    def states(self) -> object:
        return enumerate(self.simulated.states(self.q, self.openings))

    @property
    def arms(self) -> list[tuple[int, str]]:
        return list(enumerate(self.workcell.arm_names))


@pytest.fixture(scope="module", params=WORKCELLS)
def forward(request: pytest.FixtureRequest) -> Forward:
    return Forward(WORKCELLS[request.param])


def test_bases(forward: Forward) -> None:
    R, p = base_rotations(forward.workcell), base_positions(forward.workcell)
    data = next(forward.simulated.states(forward.q, forward.openings))
    for arm, name in forward.arms:
        np.testing.assert_allclose(R[arm], data.body(f"{name}/base").xmat.reshape(3, 3), **TIGHT)
        np.testing.assert_allclose(p[arm], data.body(f"{name}/base").xpos, **TIGHT)


def test_link_poses(forward: Forward) -> None:
    for n, data in forward.states():
        for arm, name in forward.arms:
            for link in range(8):
                body = data.body(f"{name}/link{link}" if link else f"{name}/base")
                np.testing.assert_allclose(
                    forward.link_rotations[link, arm, n], body.xmat.reshape(3, 3), **TIGHT
                )
                np.testing.assert_allclose(forward.link_positions[link, arm, n], body.xpos, **TIGHT)


def test_hand_pose(forward: Forward) -> None:
    for n, data in forward.states():
        for arm, name in forward.arms:
            site = data.site(f"{name}/gripper")
            np.testing.assert_allclose(
                forward.hand_rotations[arm, n], site.xmat.reshape(3, 3), **TIGHT
            )
            np.testing.assert_allclose(forward.hand_positions[arm, n], site.xpos, **TIGHT)


def test_capsules(forward: Forward) -> None:
    """Ends and radii, fingers partly open, in the order of the model's capsules."""
    model = forward.simulated.model
    radii = workcell_model(forward.workcell).capsule_radii
    for n, data in forward.states():
        for arm, name in forward.arms:
            for c, capsule in enumerate(CAPSULE_NAMES):
                geom = data.geom(f"{name}/{capsule}")
                size = model.geom(f"{name}/{capsule}").size
                axis = geom.xmat.reshape(3, 3)[:, 2] * size[1]
                np.testing.assert_allclose(forward.starts[arm, c, n], geom.xpos - axis, **TIGHT)
                np.testing.assert_allclose(forward.ends[arm, c, n], geom.xpos + axis, **TIGHT)
                assert radii[c] == size[0]


def test_capsules_are_all_that_collides(forward: Forward) -> None:
    model = forward.simulated.model
    names = [model.geom(i).name for i in range(model.ngeom) if model.geom_conaffinity[i]]
    for _, arm in forward.arms:
        own = [name.removeprefix(f"{arm}/") for name in names if name.startswith(f"{arm}/")]
        assert tuple(own) == CAPSULE_NAMES


MIRROR_IMAGES = (
    "base",
    "palm",
    *(f"finger_{side}_{part}" for side in ("left", "right") for part in ("front", "rear", "back")),
)
"""Capsules of an arm that are exact mirror images of themselves or of another finger's."""

BESIDE_MIRROR_IMAGE = {
    "shoulder": 0.032,
    "upper_arm": 0.032,
    "elbow": 0.025,
    "lower_elbow": 0.025,
    "forearm": 0.085,
    "wrist": 0.005,
    "wrist_cap": 0.019,
    "flange": 0.032,
    "hand": 0.009,
}
"""How far other capsules of a mirrored arm stand out of the arm in the mirrored posture [m]."""

REVERSED_Y = np.array([1.0, -1.0, 1.0])


def mirrored_posture(q: Floats) -> Floats:
    """The posture that does the same with y reversed; the gripper's closing axis has no direction."""
    lower, upper = PANDA.joint_limits
    # The hand is turned by -pi/4 on the flange.
    mirrored = q * [-1, 1, -1, 1, -1, 1, -1]
    mirrored[..., 6] += np.where(q[..., 6] > np.pi / 2 - upper[6], np.pi / 2, -np.pi / 2)
    assert ((mirrored >= lower) & (mirrored <= upper)).all()
    return mirrored


def segment(simulated: Simulated, data: mujoco.MjData, name: str) -> tuple[Floats, Floats, float]:
    """Both ends and the radius of a capsule."""
    geom = data.geom(name)
    radius, half = simulated.model.geom(name).size[:2]
    axis = geom.xmat.reshape(3, 3)[:, 2] * half
    return geom.xpos - axis, geom.xpos + axis, float(radius)


def both_postures(simulated: Simulated) -> Iterator[tuple[mujoco.MjData, mujoco.MjData]]:
    """The state of each sampled posture and that of its mirrored posture."""
    q, openings = sample_postures()
    here = map(copy, simulated.states(q, openings))
    there = map(copy, simulated.states(mirrored_posture(q), openings))
    yield from zip(here, there, strict=True)


def test_grippers_and_fingers_are_their_own_mirror_images() -> None:
    """What can be done with y reversed as well; the fingers change places."""
    simulated = Simulated()
    fingers = [name for name in MIRROR_IMAGES if name.startswith("finger")]
    others = [name for name in MIRROR_IMAGES if name not in fingers]

    def middles(data: mujoco.MjData, arm: str) -> list[Floats]:
        own = [data.geom(f"{arm}/{name}_collision").xpos for name in others]
        return [data.site(f"{arm}/gripper").xpos, *own]

    def ends(data: mujoco.MjData, arm: str) -> Floats:
        """Of all fingers' capsules, one after another: both ends and the radius (6, 7)."""
        found = [segment(simulated, data, f"{arm}/{name}_collision") for name in fingers]
        return np.array([[*start, *end, radius] for start, end, radius in found])

    for here, there in both_postures(simulated):
        for arm in simulated.workcell.arm_names:
            np.testing.assert_allclose(
                np.multiply(middles(here, arm), REVERSED_Y), middles(there, arm), **TIGHT
            )
            expected_ends = ends(here, arm) * [*REVERSED_Y, *REVERSED_Y, 1.0]
            differences = np.abs(expected_ends[:, None] - ends(there, arm)[None]).max(-1)
            # Each finger's capsule becomes another one, and no two the same.
            assert (differences.min(1) < TIGHT["atol"]).all()
            assert sorted(differences.argmin(1)) == list(range(6))
            axes = there.site(f"{arm}/gripper").xmat.reshape(3, 3)
            expected = here.site(f"{arm}/gripper").xmat.reshape(3, 3) * REVERSED_Y[:, None]
            np.testing.assert_allclose(axes[:, 2], expected[:, 2], **TIGHT)
            np.testing.assert_allclose(abs(axes[:, 1] @ expected[:, 1]), 1, **TIGHT)


def test_an_arm_is_nearly_its_own_mirror_image_but_for_forearm_and_flange() -> None:
    """Each capsule's surface, mirrored, against all capsules of the arm in the mirrored posture."""
    simulated = Simulated()
    generator = np.random.default_rng(0)
    worst = dict.fromkeys(PANDA.capsules.names, 0.0)
    for here, there in both_postures(simulated):
        capsules = [segment(simulated, there, f"left/{name}") for name in CAPSULE_NAMES]
        for name in worst:
            start, end, radius = segment(simulated, here, f"left/{name}_collision")
            along = generator.uniform(0, 1, (500, 1))
            normal = generator.normal(size=(500, 3))
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            points = (start + along * (end - start) + radius * normal) * REVERSED_Y
            outside = np.min([distance_from(points, *capsule) for capsule in capsules], axis=0)
            worst[name] = max(worst[name], float(outside.max()))
    limits = dict.fromkeys(MIRROR_IMAGES, 1e-9) | BESIDE_MIRROR_IMAGE
    assert set(limits) == set(worst)
    assert {name: depth for name, depth in worst.items() if depth > limits[name]} == {}


def distance_from(points: Floats, start: Floats, end: Floats, radius: float) -> Floats:
    """How far points (n, 3) are outside a capsule [m]."""
    axis = end - start
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius


def test_joint_screws(forward: Forward) -> None:
    """A screw is the joint's column of `mj_jac` for the point of its link at the world's origin."""
    model, origin = forward.simulated.model, np.zeros(3)
    for n, data in forward.states():
        for arm, name in forward.arms:
            linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, linear, angular, origin, model.body(f"{name}/link7").id)
            for joint in range(7):
                dof = model.joint(f"{name}/joint{joint + 1}").dofadr[0]
                expected = np.concatenate([angular[:, dof], linear[:, dof]])
                np.testing.assert_allclose(forward.screws[:, arm, joint, n], expected, **TIGHT)


@pytest.mark.parametrize("forward", ["facing", "side-by-side"], indirect=True)
def test_links_against_mjx(forward: Forward) -> None:
    """In two of the workcells: the others differ from them in numbers alone, and MJX compiles for long."""
    model = forward.simulated.model
    device_model, data = mjx.put_model(model), mjx.make_data(model)

    def kinematics(qpos: Floats) -> tuple[Floats, Floats]:
        moved = mjx.kinematics(device_model, data.replace(qpos=qpos))
        return moved.xpos, moved.xmat

    qpos = np.zeros((POSTURES, model.nq))
    qpos[:, forward.simulated.arm_joints] = forward.q
    qpos[:, forward.simulated.fingers] = forward.openings[:, :, None]
    positions, rotations = (np.asarray(x) for x in jax.jit(jax.vmap(kinematics))(qpos))
    for arm, name in forward.arms:
        for link in range(1, 8):
            body = model.body(f"{name}/link{link}").id
            np.testing.assert_allclose(
                forward.link_positions[link, arm], positions[:, body], **TIGHT
            )
            rotation = rotations[:, body].reshape(-1, 3, 3)
            np.testing.assert_allclose(forward.link_rotations[link, arm], rotation, **TIGHT)


@pytest.mark.parametrize("name", ["facing", "side-by-side"])
def test_a_gripper_is_shifted_up_or_back(name: str) -> None:
    """By the closed form: the hand keeps its orientation, and moves 2 to 6 cm straight up or against its approach."""
    workcell = WORKCELLS[name]
    simulated = Simulated(workcell)
    generator = np.random.default_rng(0)
    n = 32
    q = PANDA.home + generator.normal(size=(n, 7)) * 0.25
    q = np.clip(q, *PANDA.joint_limits)
    up = np.arange(n) % 2 == 0
    distance = generator.uniform(0.02, 0.06, n)
    shifted = np.asarray(shift_gripper(workcell_model(workcell), q, up, distance, np.zeros(len(q))))
    assert shifted.shape == q.shape
    same = (shifted == q).all(1)
    assert same.mean() < 0.1

    arm = workcell.arm_names[0]
    both = [np.repeat(angles[:, None], workcell.number_of_arms, 1) for angles in (q, shifted)]
    openings = np.zeros((n, workcell.number_of_arms))
    for i, (here, there) in enumerate(
        zip(*(map(copy, simulated.states(angles, openings)) for angles in both), strict=True)
    ):
        if same[i]:
            continue
        before, after = here.site(f"{arm}/gripper"), there.site(f"{arm}/gripper")
        direction = np.array([0, 0, 1.0]) if up[i] else -before.xmat.reshape(3, 3)[:, 2]
        np.testing.assert_allclose(after.xpos, before.xpos + distance[i] * direction, atol=1e-9)
        np.testing.assert_allclose(after.xmat, before.xmat, atol=1e-9)
        assert shifted[i, 6] == q[i, 6]
        assert (shifted[i] >= PANDA.joint_limits[0]).all() and (
            shifted[i] <= PANDA.joint_limits[1]
        ).all()
