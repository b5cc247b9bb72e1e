"""Sizes and variants of the network."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvr_jax.errors import DvrError

STRIDES = (1, 2, 2)
"""Strides of the convolutional layers."""

SIZE_UNIT = math.prod(STRIDES)
"""The size of an image is a multiple of this, so that the stride of every layer divides it."""

SMALLEST_IMAGE = 8
LARGEST_IMAGE = 1024
LARGEST_LAYER = 1 << 14


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the network; the defaults are the paper's, with three additions that can be switched off.

    With `rays` = 1, `normals` = False and `pooling` = False the network is exactly the paper's.
    """

    image_size: int = 64
    """Height and width of the images [pixels]."""

    rays: int = 4
    """Rays to a pixel along either axis, of which a pixel is the mean."""

    channels: tuple[int, int, int] = (5, 10, 10)
    """Channels of the three convolutional layers."""

    dense: int = 100
    """Size of an image's code and of a symbol's code."""

    hidden: int = 300
    """Size of the GRU's hidden state."""

    normals: bool = True
    """Whether a grasp's symbol comes with the normal of the face.

    Without normals, a face is known only by the direction in which it looks, to within 45 degrees.
    """

    pooling: bool = True
    """Whether an image's code also sees the maximum of each last channel over the image.

    Without pooling, the dense layer has to learn anew for each place what stands there.
    """

    goal: bool = True
    """Whether the goal's tuple is an input; without it, the network is the recurrent feasibility classifier."""

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check_switches()
        self._check_image_size()

    def _check_numbers(self) -> None:
        """Refuse sizes that are no positive whole numbers, or that no computer can hold."""
        numbers = {
            "image_size": self.image_size,
            "rays": self.rays,
            "dense": self.dense,
            "hidden": self.hidden,
        }
        for index, value in enumerate(self.channels):
            numbers[f"channels[{index}]"] = value

        for name, value in numbers.items():
            if type(value) is not int or not 1 <= value <= LARGEST_LAYER:
                raise DvrError(
                    f"the network's {name} is {value}; valid are whole numbers from 1 to {LARGEST_LAYER}."
                )
        if len(self.channels) != len(STRIDES):
            raise DvrError(
                f"the network's channels are {self.channels}; valid are {len(STRIDES)} numbers."
            )

    def _check_switches(self) -> None:
        """Refuse switches that are neither true nor false."""
        for name in ("normals", "pooling", "goal"):
            value = getattr(self, name)
            if type(value) is not bool:
                raise DvrError(f"the network's {name} is {value!r}; valid are true and false.")

    def _check_image_size(self) -> None:
        """Refuse images that the strides do not divide, or that take too many rays."""
        if not SMALLEST_IMAGE <= self.image_size <= LARGEST_IMAGE or self.image_size % SIZE_UNIT:
            raise DvrError(
                f"the images' size is {self.image_size} pixels; valid are multiples of {SIZE_UNIT} from "
                f"{SMALLEST_IMAGE} to {LARGEST_IMAGE}."
            )
        if self.rays * self.image_size > LARGEST_IMAGE:
            raise DvrError(
                f"{self.rays} rays to each of {self.image_size} pixels are {self.rays * self.image_size}; valid are at "
                f"most {LARGEST_IMAGE} along an axis."
            )
