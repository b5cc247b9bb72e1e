"""Pinhole cameras: where they stand, which ray belongs to which pixel, and the one camera that senses a scene.

Camera frame as in MuJoCo: x right, y up, looking along -z. Pixel (0, 0) is the image's upper left; rays pass through
pixel centres. A ray's vector has length 1 *along the optical axis*, so that a ray caster's distance is the depth.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera at `position` that looks at `target`, with the world's +y or +z pointing up in the image."""

    position: tuple[float, float, float]
    """Centre of projection in the world, m."""
    target: tuple[float, float, float]
    """A point on the optical axis, m."""
    field_of_view: float
    """Full vertical angle of view, rad; the horizontal one follows from the image's aspect."""

    def rotation(self) -> NDArray[np.float64]:
        """R_world_camera (3, 3): columns are the camera's x (right), y (up) and z (backwards) in the world."""
        backward = np.subtract(self.position, self.target)
        backward = backward / np.linalg.norm(backward)
        # Upright is +z, unless the camera looks straight down: then +y.
        upright = np.array([0.0, 1.0, 0.0]) if abs(backward[2]) > 0.999 else np.array([0.0, 0.0, 1.0])
        right = np.cross(upright, backward)
        right = right / np.linalg.norm(right)
        return np.column_stack([right, np.cross(backward, right), backward])

    def rays(
        self, columns: NDArray[np.float64], rows: NDArray[np.float64], width: int, height: int
    ) -> NDArray[np.float64]:
        """World vectors (..., 3) of the rays through points of the image (...), pixels from its upper left."""
        slope = math.tan(self.field_of_view / 2)
        x = (2 * columns / width - 1) * slope * width / height
        y = (1 - 2 * rows / height) * slope
        local = np.stack(np.broadcast_arrays(x, y, -1.0), axis=-1)
        return np.asarray(local @ self.rotation().T)

    def pixel_rays(self, width: int, height: int) -> NDArray[np.float64]:
        """World vectors of the rays through all pixel centres (height, width, 3)."""
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return self.rays(columns, rows, width, height)

    def window(self, center: ArrayLike, radius: float, width: int, height: int) -> tuple[slice, slice]:
        """ConstraintValues and columns of an image outside of which no ray meets a ball in the world [m]; all of them if the
        camera is in the ball's slab or behind it."""
        local = (np.asarray(center) - self.position) @ self.rotation()
        nearest, farthest = -local[2] - radius, -local[2] + radius
        if nearest <= 0:
            return slice(0, height), slice(0, width)
        slope = math.tan(self.field_of_view / 2)
        sides = []
        for along, pixels, half in ((-local[1], height, slope), (local[0], width, slope * width / height)):
            ends = [(along + shift) / depth for shift in (-radius, radius) for depth in (nearest, farthest)]
            first, last = (pixels * (1 + end / half) / 2 for end in (min(ends), max(ends)))
            sides.append(slice(min(max(math.floor(first), 0), pixels), min(max(math.ceil(last), 0), pixels)))
        rows, columns = sides
        return rows, columns


SCENE_CAMERA = Pinhole(position=(0.0, 0.0, 2.6), target=(0.0, 0.0, 0.0), field_of_view=math.radians(46.0))
"""The camera that senses every scene: straight down from 2.6 m, image right is +x, up is +y; a square image shows the
table within +-1.1 m. Why straight down: from there neither the arms (whose home postures project towards their
bases) nor other objects hide much of an object; from 40 to 70 degrees of elevation some objects are lost."""
