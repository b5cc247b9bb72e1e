"""Pinhole cameras: where they stand, which ray belongs to which pixel, and the one camera that senses a scene.

Camera frame as in MuJoCo: x points right, y up, and the camera looks along -z. Pixel (0, 0) is the image's upper left
one; rays pass through the centers of pixels. A ray's vector has length 1 *along the optical axis*, so the distance that
a ray caster measures in multiples of the vector is the depth.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera that stands upright, with the world's +z up in the image (+y if it looks straight down)."""

    position: tuple[float, float, float]
    """Center of projection in the world [m]."""

    target: tuple[float, float, float]
    """A point on the optical axis [m]."""

    field_of_view: float
    """Full vertical angle of view [rad]; the horizontal one follows from the image's aspect."""

    @property
    def slope(self) -> float:
        """Tangent of half the vertical angle of view."""
        return math.tan(self.field_of_view / 2)

    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rotation R_world_camera: its columns are the camera's right, up and backward directions in the world."""
        backward = np.subtract(self.position, self.target)
        backward = backward / np.linalg.norm(backward)

        looks_straight_down = abs(backward[2]) > 0.999
        upright = np.array([0.0, 1.0, 0.0]) if looks_straight_down else np.array([0.0, 0.0, 1.0])
        right = np.cross(upright, backward)
        right = right / np.linalg.norm(right)

        return np.column_stack([right, np.cross(backward, right), backward])

    def rays(
        self,
        columns: Float[np.ndarray, "..."],
        rows: Float[np.ndarray, "..."],
        width: int,
        height: int,
    ) -> Float[np.ndarray, "... 3"]:
        """World vectors of the rays through points of the image.

        Args:
            columns: Distances of the points from the image's left border [pixels].
            rows: Distances of the points from the image's upper border [pixels].
            width: Width of the image [pixels].
            height: Height of the image [pixels].

        Returns:
            Vectors of length 1 along the optical axis [m].
        """
        slope = self.slope
        x = (2 * columns / width - 1) * slope * width / height
        y = (1 - 2 * rows / height) * slope
        local = np.stack(np.broadcast_arrays(x, y, -1.0), axis=-1)

        return np.asarray(local @ self.rotation().T)

    def pixel_rays(self, width: int, height: int) -> Float[np.ndarray, "height width 3"]:
        """World vectors of the rays through the centers of all pixels.

        Args:
            width: Width of the image [pixels].
            height: Height of the image [pixels].

        Returns:
            Vectors of length 1 along the optical axis [m].
        """
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return self.rays(columns, rows, width, height)

    def window(
        self,
        center: tuple[float, float, float],
        radius: float,
        width: int,
        height: int,
    ) -> tuple[slice, slice]:
        """Part of an image outside of which no ray meets a ball.

        The slopes of the rays to a ball lie between those to the corners of the slab that holds it.

        Args:
            center: Center of the ball in the world [m].
            radius: Radius of the ball [m].
            width: Width of the image [pixels].
            height: Height of the image [pixels].

        Returns:
            Rows and columns; all of them if the camera is in the ball's slab or behind it.
        """
        local = (np.asarray(center) - self.position) @ self.rotation()
        nearest = -local[2] - radius
        farthest = -local[2] + radius
        if nearest <= 0:
            return slice(0, height), slice(0, width)

        def extent(offset: float, pixels: int, slope: float) -> slice:
            """Pixels of one axis between the least and the largest slope."""
            slopes = [
                (offset + shift) / depth
                for shift in (-radius, radius)
                for depth in (nearest, farthest)
            ]
            first = math.floor(pixels * (1 + min(slopes) / slope) / 2)
            last = math.ceil(pixels * (1 + max(slopes) / slope) / 2)

            return slice(min(max(first, 0), pixels), min(max(last, 0), pixels))

        rows = extent(-local[1], height, self.slope)
        columns = extent(local[0], width, self.slope * width / height)

        return rows, columns


SCENE_CAMERA = Pinhole(
    position=(0.0, 0.0, 2.6), target=(0.0, 0.0, 0.0), field_of_view=math.radians(46.0)
)
"""The camera that senses every scene: it looks straight down from 2.6 m; right in the image is +x, up is +y, and a
square image shows the table within +-1.1 m. From there neither the arms, whose home postures project towards their
bases, nor other objects hide much of an object; seen from 40 to 70 degrees of elevation some objects are lost."""
