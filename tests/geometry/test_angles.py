"""Angles against NumPy's."""

import jax
import numpy as np
import pytest

from dvr_jax.geometry.angles import arctan2


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 4e-7), (np.float64, 4e-15)])
def test_arctan2(dtype: type, tolerance: float) -> None:
    generator = np.random.default_rng(0)
    y, x = generator.normal(size=(2, 200_000)) * np.exp(4 * generator.normal(size=(2, 200_000)))
    ends = np.array([-1.0, 0.0, 1.0])
    y, x = (
        np.append(some, grid).astype(dtype)
        for some, grid in zip((y, x), np.meshgrid(ends, ends), strict=True)
    )
    with jax.enable_x64(dtype is np.float64):
        angle = np.asarray(jax.jit(arctan2)(y, x))
    assert angle.dtype == dtype
    expected = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    np.testing.assert_allclose(angle, expected, rtol=0, atol=tolerance)
    # Small angles keep their digits.
    ahead = (x > 0) & (np.abs(y) < np.abs(x))
    np.testing.assert_allclose(angle[ahead], expected[ahead], rtol=tolerance)
