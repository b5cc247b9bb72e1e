"""Rows of objects that are put on other objects, against their definition with rotations of SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from dvr_jax.modes.mode import ModeKind


def test_rows_are_the_offsets_in_the_lower_object(stacks) -> None:
    case = stacks.case
    rows = stacks.results.rows["on_top"]
    seen = set()
    for b in range(case.batch):
        for k in range(rows.shape[1]):
            half = case.problems.top_half[b, k, 0]
            if half[0] == 0:
                np.testing.assert_array_equal(rows[b, k], -1)
                continue
            lower = case.problems.top_object[b, k, 0]
            kind = case.problems.mode_kind[b, k, lower]
            seen.add(kind)
            if kind == ModeKind.PLACED:
                x, y, yaw, _ = case.x.m[b, case.problems.mode_action[b, k, lower]]
            else:
                x, y, _, yaw = case.problems.initial_pose[b, lower]
            away = np.array([*case.x.m[b, k, :2], 0.0]) - [x, y, 0.0]
            local = Rotation.from_euler("z", yaw).inv().apply(away)[:2]
            np.testing.assert_allclose(rows[b, k], [*(local - half), *(-local - half)], atol=1e-12)
    assert seen == {ModeKind.PLACED, ModeKind.FIXED}


def test_an_upper_object_stands_at_the_height_of_the_lower_ones(stacks) -> None:
    """The can is 14 cm high, and the yellow box 10 cm."""
    problems = stacks.case.problems
    np.testing.assert_allclose(problems.parameter_lower[0, [1, 3], 3], [0.14, 0.24])
    np.testing.assert_allclose(problems.parameter_upper[0, [1, 3], 3], [0.14, 0.24])
