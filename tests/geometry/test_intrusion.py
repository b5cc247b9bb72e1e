"""By how much footprints cover rectangles: against the exact distances of `dvr_jax.geometry.footprint`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dvr_jax.geometry.footprint import Circle, Rectangle, signed_distance
from dvr_jax.geometry.intrusion import intrusion


def draw(number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(number)
    m = generator.uniform(-0.3, 0.3, (4, 400))
    m[2] = generator.uniform(-7, 7, 400)
    outline = generator.uniform(0.02, 0.15, (3, 400))
    outline[2] = 0
    rectangle = generator.uniform(-0.3, 0.3, (5, 400))
    rectangle[2] = generator.uniform(-7, 7, 400)
    rectangle[3:] = generator.uniform(0.02, 0.2, (2, 400))
    return m, outline, rectangle


def rectangle_of(numbers: np.ndarray) -> Rectangle:
    x, y, yaw, width, depth = numbers.tolist()
    return Rectangle((x, y), (width, depth), yaw)


def test_boxes_cover_a_rectangle_by_their_overlap() -> None:
    m, outline, rectangle = draw(0)
    with jax.enable_x64(True):
        covered, _ = intrusion(jnp.asarray(m), jnp.asarray(outline), jnp.asarray(rectangle))
    overlapping = 0
    for i, depth in enumerate(np.asarray(covered).tolist()):
        box = Rectangle((m[0, i], m[1, i]), (outline[0, i], outline[1, i]), m[2, i])
        exact = -signed_distance(box, rectangle_of(rectangle[:, i]))
        overlapping += exact > 0
        # Apart, the largest gap along one of the sides is at most the distance.
        if exact > 0:
            assert depth == pytest.approx(exact, abs=1e-9)
        else:
            assert exact - 1e-9 <= depth <= 1e-9
    assert 50 < overlapping < 350


def test_a_disc_that_covers_nothing_is_apart() -> None:
    m, outline, rectangle = draw(1)
    outline[2] = outline[0]
    outline[:2] = 0
    with jax.enable_x64(True):
        covered, _ = intrusion(jnp.asarray(m), jnp.asarray(outline), jnp.asarray(rectangle))
    for i, depth in enumerate(np.asarray(covered).tolist()):
        disc = Circle((m[0, i], m[1, i]), outline[2, i])
        assert depth >= -signed_distance(disc, rectangle_of(rectangle[:, i])) - 1e-12


def test_derivatives_are_those_of_central_differences() -> None:
    m, outline, rectangle = draw(2)
    step = 1e-6
    with jax.enable_x64(True):
        _, slopes = intrusion(jnp.asarray(m), jnp.asarray(outline), jnp.asarray(rectangle))
        for parameter in range(4):
            shift = step * np.eye(4)[parameter][:, None]
            ahead, behind = (
                np.asarray(intrusion(jnp.asarray(m + sign * shift), outline, rectangle)[0])
                for sign in (1, -1)
            )
            error = np.abs((ahead - behind) / (2 * step) - np.asarray(slopes)[parameter])
            # At a kink, where another side becomes the one of the largest gap, the two disagree.
            assert np.quantile(error, 0.99) < 1e-5
