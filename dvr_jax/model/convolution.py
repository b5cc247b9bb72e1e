"""The network's 5x5 convolutions as 3x3 convolutions of space-to-depth images, which CPUs compute faster.

Space to depth turns an image (H, W, C) of even size into (H/2, W/2, 4 C): each new pixel holds a block of 2 x 2 old
ones. On such images

- a 5x5 convolution with stride 2 is a 3x3 convolution with stride 1, whose output is a plain image (H/2, W/2, D);
- a 5x5 convolution with stride 1 is a 3x3 convolution with stride 1, whose output is a space-to-depth image of the
  plain output (H, W, D).

The 3x3 kernel holds the 5x5 one, surrounded by zeros, as it lies among the blocks. Padding is "SAME". The sums are the
same as those of the 5x5 convolution. With only a few channels, XLA's convolutions on a CPU spend their time on
everything but products, so four times as many channels make up for the products with zeros.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

PIXELS_AT_ONCE = 4
"""Largest number of pixels of an image row that a kernel's gradient takes together."""

IMAGES_AT_ONCE = 8
"""Largest number of images that a kernel's gradient takes together."""


def space_to_depth(
    images: Float[Array, "images height width channels"],
) -> Float[Array, "images rows columns depth"]:
    """Return images of even size as blocks of 2 x 2 pixels, (B, H, W, C) as (B, H/2, W/2, 4 C)."""
    number, height, width, channels = images.shape
    blocks = images.reshape(number, height // 2, 2, width // 2, 2, channels)
    blocks = blocks.transpose(0, 1, 3, 2, 4, 5)
    return blocks.reshape(number, height // 2, width // 2, 4 * channels)


def stride_one_kernel(
    kernel: Float[Array, "5 5 channels outputs"],
) -> Float[Array, "3 3 depth packed_outputs"]:
    """Return the 3x3 kernel of a 5x5 convolution with stride 1, (3, 3, 4 C, 4 D); the output is space to depth."""
    # A row of three blocks has six pixels. Output pixel a of the middle block is a sum over the pixels a to a + 4.
    rows = []
    for row in range(2):
        columns = [_place_in_blocks(kernel, row, column) for column in range(2)]
        rows.append(jnp.stack(columns, axis=-2))
    placed = jnp.stack(rows, axis=-3)
    return placed.reshape(3, 3, -1, 4 * kernel.shape[-1])


def stride_two_kernel(
    kernel: Float[Array, "5 5 channels outputs"],
) -> Float[Array, "3 3 depth outputs"]:
    """Return the 3x3 kernel of a 5x5 convolution with stride 2, (3, 3, 4 C, D); the output is a plain image."""
    # "SAME" pads an even size by one pixel before and two behind, so the sum is over the pixels 1 to 5 of the six.
    return _place_in_blocks(kernel, 1, 1).reshape(3, 3, -1, kernel.shape[-1])


def _place_in_blocks(
    kernel: Float[Array, "5 5 channels outputs"],
    row: int,
    column: int,
) -> Float[Array, "3 3 2 2 channels outputs"]:
    """Return a 5x5 kernel at an offset of 0 or 1 in 6 x 6 pixels of zeros, and these as 3 x 3 blocks of 2 x 2."""
    padded = jnp.pad(kernel, ((row, 1 - row), (column, 1 - column), (0, 0), (0, 0)))
    blocks = padded.reshape(3, 2, 3, 2, *kernel.shape[2:])
    return blocks.transpose(0, 2, 1, 3, 4, 5)


@jax.custom_vjp
def convolve(
    images: Float[Array, "images height width channels"],
    kernel: Float[Array, "3 3 channels outputs"],
) -> Float[Array, "images height width outputs"]:
    """Convolve images with a 3x3 kernel, with stride 1 and padding "SAME".

    Args:
        images: The images.
        kernel: The kernel; as in all deep learning, it is not reversed.

    Returns:
        The sums, for images of the same size.
    """
    return jax.lax.conv_general_dilated(
        images,
        kernel,
        window_strides=(1, 1),
        padding="SAME",
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )


def _convolve_forward(images: Array, kernel: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the convolution, and what its gradient needs."""
    return convolve(images, kernel), (images, kernel)


def _convolve_backward(residuals: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    """Return the gradients of images and kernel from that of the output."""
    images, kernel = residuals
    reversed_kernel = kernel[::-1, ::-1].swapaxes(2, 3)
    return convolve(gradient, reversed_kernel), _kernel_gradient(images, gradient)


convolve.defvjp(_convolve_forward, _convolve_backward)


def _kernel_gradient(
    images: Float[Array, "images height width channels"],
    gradient: Float[Array, "images height width outputs"],
) -> Float[Array, "3 3 channels outputs"]:
    """Return the gradient of the kernel from the images and the gradient of the output.

    A run of R neighboring output pixels sees R + 2 input pixels of each of three image rows. The products of all these
    pixels are one matrix product over the runs, and the products of pixels that see each other are added up. The images
    are taken a few at a time, so that their runs stay in the cache: all images at once take twice as long.
    """
    number, height, width, channels = images.shape
    run = math.gcd(width, PIXELS_AT_ONCE)
    part = math.gcd(number, IMAGES_AT_ONCE)

    def add_part(total: Array, images_and_gradient: tuple[Array, Array]) -> tuple[Array, None]:
        some_images, some_gradient = images_and_gradient
        padded = jnp.pad(some_images, ((0, 0), (1, 1), (1, 1), (0, 0)))
        slices = [padded[:, :, x : x + run + 2] for x in range(0, width, run)]
        runs = jnp.stack(slices, axis=2)
        runs = runs.reshape(part, height + 2, width // run, -1)

        outputs = some_gradient.reshape(-1, run * some_gradient.shape[-1])
        products = []
        for row in range(3):
            inputs = runs[:, row : row + height].reshape(len(outputs), -1)
            products.append(inputs.T @ outputs)
        return total + jnp.stack(products), None

    shape = (number // part, part, height, width, -1)
    parts = (images.reshape(shape), gradient.reshape(shape))
    zero = jnp.zeros((3, (run + 2) * channels, run * gradient.shape[-1]), images.dtype)
    total, _ = jax.lax.scan(add_part, zero, parts)

    # Output pixel x of a run sees the input pixels x, x + 1 and x + 2 through the three columns of the kernel.
    total = total.reshape(3, run + 2, channels, run, -1)
    columns = [sum(total[:, x + column, :, x] for x in range(run)) for column in range(3)]
    return jnp.stack(columns, axis=1)


@jax.custom_vjp
def take_images(
    images: Float[Array, "images ..."],
    index: Int[Array, " chosen"],
) -> Float[Array, "chosen ..."]:
    """Return the images with these indices; the gradient is a matrix product.

    The gradient of plain indexing adds up where indices repeat, which is slow.

    Args:
        images: The images to choose from.
        index: Index of each chosen image; an index equal to the number of images stands for zeros.

    Returns:
        The chosen images.
    """
    return images.at[index].get(mode="fill", fill_value=0)


def _take_forward(images: Array, index: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the chosen images, and what their gradient needs."""
    # An empty array carries the number of images, which is static.
    empty = jnp.zeros((len(images), 0), images.dtype)
    return take_images(images, index), (index, empty)


def _take_backward(residuals: tuple[Array, Array], gradient: Array) -> tuple[Array, None]:
    """Return the gradient of the images from that of the chosen ones; an index has none."""
    index, images = residuals
    is_chosen = jax.nn.one_hot(index, len(images), axis=0, dtype=gradient.dtype)
    flat = gradient.reshape(len(index), -1)
    of_images = jnp.matmul(is_chosen, flat, precision="highest")
    return of_images.reshape(-1, *gradient.shape[1:]), None


take_images.defvjp(_take_forward, _take_backward)
