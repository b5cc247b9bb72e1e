"""The network's 5x5 convolutions as 3x3 ones of packed images: the same sums, in a form that CPUs are good at.

An image (H, W, C) of even size is packed to (H/2, W/2, 4 C): each pixel holds a block of 2 x 2. Then a 5x5 convolution
with stride 2 is a 3x3 one with stride 1 and the output is not packed; one with stride 1 is a 3x3 one whose output is
packed as well. The 3x3 kernel holds the 5x5 one, with zeros around it as it lies among the blocks; padding is "SAME".
With a few channels only, XLA's convolutions on a CPU spend their time on everything but products, so four times as
many channels make up for the products with zeros.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp

RUN, PART = 4, 8
"""At most so many pixels of a row, and so many images, at once in a kernel's gradient."""


def pack(images: jax.Array) -> jax.Array:
    """Images (B, H, W, C) of even size as blocks (B, H/2, W/2, 4 C)."""
    number, height, width, channels = images.shape
    blocks = images.reshape(number, height // 2, 2, width // 2, 2, channels)
    return blocks.transpose(0, 1, 3, 2, 4, 5).reshape(number, height // 2, width // 2, 4 * channels)


def packed_kernel(kernel: jax.Array) -> jax.Array:
    """A kernel (5, 5, C, D) for stride 1, from packed images to packed ones (3, 3, 4 C, 4 D)."""
    # Output pixel a of a block is the sum over the pixels a to a + 4 of the six in three blocks.
    placed = jnp.stack([jnp.stack([_place(kernel, a, b) for b in range(2)], axis=-2) for a in range(2)], axis=-3)
    return placed.reshape(3, 3, -1, 4 * kernel.shape[-1])


def halving_kernel(kernel: jax.Array) -> jax.Array:
    """A kernel (5, 5, C, D) for stride 2, from packed images to plain ones of half the size (3, 3, 4 C, D)."""
    # "SAME" pads an even size by one pixel before and two behind: the sum is over the pixels 1 to 5 of the six.
    return _place(kernel, 1, 1).reshape(3, 3, -1, kernel.shape[-1])


@jax.custom_vjp
def convolve(images: jax.Array, kernel: jax.Array) -> jax.Array:
    """Convolution (B, H, W, D) of images (B, H, W, C) with a kernel (3, 3, C, D), stride 1, "SAME"."""
    return jax.lax.conv_general_dilated(images, kernel, (1, 1), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"))


def _convolve_forward(images: jax.Array, kernel: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    return convolve(images, kernel), (images, kernel)


def _convolve_backward(known: tuple[jax.Array, jax.Array], gradient: jax.Array) -> tuple[jax.Array, jax.Array]:
    images, kernel = known
    return convolve(gradient, kernel[::-1, ::-1].swapaxes(2, 3)), _kernel_gradient(images, gradient)


convolve.defvjp(_convolve_forward, _convolve_backward)


def _kernel_gradient(images: jax.Array, gradient: jax.Array) -> jax.Array:
    """Gradient (3, 3, C, D) with respect to the kernel from images (B, H, W, C) and the output's gradient (B, H, W, D).

    A run of `run` output pixels sees run + 2 input pixels of each of three rows. All products of these pixels are
    matrix products over the runs, and those of pixels that see each other are added up. Some images at a time, so that
    the runs stay in the cache: all at once is half as fast."""
    number, height, width, channels = images.shape
    run, part = math.gcd(width, RUN), math.gcd(number, PART)

    def add(total: jax.Array, some: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, None]:
        seen, back = some
        padded = jnp.pad(seen, ((0, 0), (1, 1), (1, 1), (0, 0)))
        runs = jnp.stack([padded[:, :, x : x + run + 2] for x in range(0, width, run)], axis=2)
        runs = runs.reshape(part, height + 2, width // run, -1)
        ends = back.reshape(-1, run * back.shape[-1])
        rows = [runs[:, y : y + height].reshape(len(ends), -1).T @ ends for y in range(3)]
        return total + jnp.stack(rows), None

    shape = (number // part, part, height, width, -1)
    start = jnp.zeros((3, (run + 2) * channels, run * gradient.shape[-1]), images.dtype)
    total, _ = jax.lax.scan(add, start, (images.reshape(shape), gradient.reshape(shape)))
    total = total.reshape(3, run + 2, channels, run, -1)
    return jnp.stack([sum(total[:, x + column, :, x] for x in range(run)) for column in range(3)], axis=1)


@jax.custom_vjp
def take(images: jax.Array, index: jax.Array) -> jax.Array:
    """Images `index` (B,) of (A, ...), zeros where the index is A; the gradient is a matrix product, because adding
    up where indices repeat is slow otherwise."""
    return images.at[index].get(mode="fill", fill_value=0)


def _take_forward(images: jax.Array, index: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    # An empty array carries the number of images, which is static.
    return take(images, index), (index, jnp.zeros((len(images), 0), images.dtype))


def _take_backward(known: tuple[jax.Array, jax.Array], gradient: jax.Array) -> tuple[jax.Array, None]:
    index, images = known
    chosen = jax.nn.one_hot(index, len(images), axis=0, dtype=gradient.dtype)
    flat = gradient.reshape(len(index), -1)
    return jnp.matmul(chosen, flat, precision="highest").reshape(-1, *gradient.shape[1:]), None


take.defvjp(_take_forward, _take_backward)


def _place(kernel: jax.Array, row: int, column: int) -> jax.Array:
    """The kernel (5, 5, C, D) at an offset in 6 x 6 pixels of zeros, these as 3 x 3 blocks (3, 3, 2, 2, C, D)."""
    padded = jnp.pad(kernel, ((row, 1 - row), (column, 1 - column), (0, 0), (0, 0)))
    return padded.reshape(3, 2, 3, 2, *kernel.shape[2:]).transpose(0, 2, 1, 3, 4, 5)
