"""Fast motions along paths: against a bang-bang profile by hand, TOPP-RA, and the limits at 1 kHz."""

import numpy as np
import pytest
import toppra
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

from dvr_jax.motion.dynamics import arm_dynamics
from dvr_jax.motion.retiming import TIME_STEP, MotionLimits, time_optimal
from dvr_jax.workcell.panda import PANDA

Floats = NDArray[np.float64]

LIMITS = MotionLimits(
    PANDA.joint_velocity, PANDA.joint_acceleration, PANDA.joint_jerk, PANDA.joint_torque
)


def weightless(q: Floats, velocity: Floats, acceleration: Floats) -> Floats:
    return np.zeros_like(q)


def panda(q: Floats, velocity: Floats, acceleration: Floats) -> Floats:
    return arm_dynamics(PANDA).torques(q, velocity, acceleration, mass=1.0)


def random_path(seed: int) -> Floats:
    """Dense points of a smooth path between random postures near home."""
    generator = np.random.default_rng(seed)
    knots = PANDA.home + np.cumsum(generator.normal(0, 0.25, (6, 7)), axis=0)
    knots = np.clip(knots, *PANDA.joint_limits)
    return CubicSpline(np.arange(6), knots)(np.linspace(0, 5, 101))


def at_1_khz(samples: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Angles, velocities, accelerations and jerks of the spline through the samples, between two pauses."""
    paused = np.concatenate([np.tile(samples[:1], (5, 1)), samples, np.tile(samples[-1:], (5, 1))])
    time = TIME_STEP * np.arange(len(paused))
    spline = CubicSpline(time, paused, bc_type="clamped")
    fine = np.arange(0, time[-1], 1e-3)
    return spline(fine), spline(fine, 1), spline(fine, 2), spline(fine, 3)


@pytest.mark.parametrize("seed", range(4))
def test_no_limit_is_exceeded_at_1_khz(seed: int) -> None:
    samples = time_optimal(random_path(seed), LIMITS, panda)
    q, velocity, acceleration, jerk = at_1_khz(samples)
    assert (np.abs(velocity) <= PANDA.joint_velocity).all()
    assert (np.abs(acceleration) <= PANDA.joint_acceleration).all()
    assert (np.abs(jerk) <= PANDA.joint_jerk).all()
    torque = panda(q, velocity, acceleration)
    assert (np.abs(torque) <= PANDA.joint_torque).all()

    # Some limit is nearly reached: the motion is no slow one.
    used = max(
        (np.abs(velocity) / PANDA.joint_velocity).max(),
        (np.abs(acceleration) / PANDA.joint_acceleration).max(),
        (np.abs(torque) / PANDA.joint_torque).max(),
    )
    assert used > 0.85


@pytest.mark.parametrize("seed", range(4))
def test_the_path_is_kept(seed: int) -> None:
    """Every sample lies on the path, and the ends are its ends."""
    points = random_path(seed)
    samples = time_optimal(points, LIMITS, panda)
    np.testing.assert_allclose(samples[[0, -1]], points[[0, -1]], atol=1e-9)
    dense = CubicSpline(np.linspace(0, 1, len(points)), points)(np.linspace(0, 1, 20_001))
    distance = np.linalg.norm(samples[:, None] - dense, axis=2).min(axis=1)
    assert distance.max() < 1e-3


def fastest(points: Floats, limits: MotionLimits) -> float:
    """Duration by the library toppra without limits of jerk and torque, with the whole of the other limits [s]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    path = toppra.SplineInterpolator(length, points)

    def both(limit: Floats) -> Floats:
        return np.stack([-limit, limit], axis=1)

    constraints = [
        JointVelocityConstraint(both(limits.velocity)),
        JointAccelerationConstraint(both(limits.acceleration)),
    ]
    grid = np.interp(np.linspace(0, 1, 401), np.linspace(0, 1, len(length)), length)
    solver = TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    return float(solver.compute_trajectory(0, 0).duration)


@pytest.mark.parametrize("seed", range(4))
def test_it_takes_little_longer_than_topp_ra_needs(seed: int) -> None:
    points = random_path(seed)
    reference = fastest(points, LIMITS)
    samples = time_optimal(points, LIMITS, weightless)
    duration = TIME_STEP * (len(samples) - 1)
    assert 0.99 * reference < duration < 1.12 * reference


def path_with_a_corner() -> Floats:
    """Two straight lines of 0.8 rad in two joints, with an arc of the radius 0.02 rad between them."""
    radius = 0.02
    line = np.linspace(0, 0.8, 60)[:-1]
    angle = np.linspace(0, np.pi / 2, 25)
    first = np.stack([line, np.zeros_like(line)], axis=1)
    arc = np.stack([0.8 + radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1)
    second = np.stack([np.full_like(line, 0.8 + radius), 0.8 + radius - line[::-1]], axis=1)
    return np.concatenate([first, arc, second])


def test_a_sharp_corner_makes_a_motion_slow_only_around_it() -> None:
    points = path_with_a_corner()
    none = np.full(2, np.inf)
    limits = MotionLimits(np.full(2, 2.0), np.full(2, 10.0), none, none)
    samples = time_optimal(points, limits, weightless)
    q, velocity, acceleration, _ = at_1_khz(samples)
    assert np.abs(velocity).max() <= 2.0
    assert np.abs(acceleration).max() <= 10.0

    # On both lines, away from the corner, the motion reaches the limits.
    away = np.linalg.norm(q - [0.8, 0.0], axis=1) > 0.4
    assert np.abs(velocity[away]).max() > 0.95 * 2.0
    assert np.abs(acceleration[away]).max() > 0.93 * 10.0


def test_a_sharp_corner_costs_little_more_than_by_topp_ra() -> None:
    points = path_with_a_corner()
    none = np.full(2, np.inf)
    limits = MotionLimits(np.full(2, 2.0), np.full(2, 10.0), none, none)
    reference = fastest(points, limits)
    duration = TIME_STEP * (len(time_optimal(points, limits, weightless)) - 1)
    assert 0.99 * reference < duration < 1.12 * reference


def test_torques_are_kept_where_they_bind_and_ignored_where_no_timing_helps() -> None:
    """With limits that the arm nearly needs at rest, and with limits below its weight."""
    points = random_path(1)
    rest = np.zeros_like(points)
    weight = np.abs(panda(points, rest, rest)).max(axis=0)
    scarce = MotionLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk, 1.15 * weight + 1.0)
    samples = time_optimal(points, scarce, panda)
    q, velocity, acceleration, _ = at_1_khz(samples)
    assert (np.abs(panda(q, velocity, acceleration)) <= 1.01 * scarce.torque).all()
    assert len(samples) > len(time_optimal(points, LIMITS, panda))

    # The shoulder cannot hold the arm still.
    torque = LIMITS.torque.copy()
    torque[1] = 0.9 * weight[1]
    weak = MotionLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk, torque)
    assert len(time_optimal(points, weak, panda)) * TIME_STEP < 10.0


def test_a_single_joint_moves_as_a_trapezoid() -> None:
    """Duration by hand: distance / speed + speed / acceleration, for a joint that reaches its top speed."""
    speed = 2.0
    acceleration = 10.0
    none = np.full(1, np.inf)
    limits = MotionLimits(np.array([speed]), np.array([acceleration]), none, none)
    samples = time_optimal(np.linspace(0, 3.0, 60)[:, None], limits, weightless)
    expected = 3.0 / speed + speed / acceleration
    duration = TIME_STEP * (len(samples) - 1)
    assert expected < duration < 1.06 * expected + 0.06


def test_a_shortest_time_makes_a_part_of_the_path_slow() -> None:
    points = random_path(0)
    times = np.zeros(len(points) - 1)
    times[80:] = 0.05
    plain = time_optimal(points, LIMITS, weightless)
    slow = time_optimal(points, LIMITS, weightless, times)
    assert TIME_STEP * (len(slow) - len(plain)) > 0.4
    # The slow part alone takes as long as asked for.
    nearest = np.linalg.norm(slow[:, None] - points, axis=2).argmin(axis=1)
    assert TIME_STEP * (nearest > 80).sum() > 0.95 * times.sum()


def test_heavier_loads_take_longer_where_torques_bind() -> None:
    """With four fifths of the torque limits."""
    points = random_path(1)
    weak = MotionLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk, 0.8 * LIMITS.torque)

    def loaded(mass: float) -> int:
        dynamics = arm_dynamics(PANDA)
        return len(time_optimal(points, weak, lambda q, v, a: dynamics.torques(q, v, a, mass)))

    assert loaded(3.0) > loaded(0.0)


def test_what_does_not_move_is_a_single_sample() -> None:
    points = np.tile(PANDA.home, (20, 1))
    np.testing.assert_array_equal(time_optimal(points, LIMITS, weightless), points[-1:])
