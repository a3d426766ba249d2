"""Normalised patches of an image, in Warp: integers throughout."""

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _patches_cpu as cpu

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WHITE = wp.constant(float(codes.WHITE))
SPREAD = wp.constant(wp.float64(codes.SPREAD))
LARGEST = wp.constant(codes.LARGEST)
# Halves are rounded up. A quotient by R < 2^24 that is no multiple of 1 / 2 is at least 2^-25 from
# one, and is computed to 2^-40, so that adding 2^-30 makes no difference but to multiples.
HALF = wp.constant(wp.float64(0.5 + 2.0**-30))


def round_pixels(image: wp.array, pixels: wp.array) -> None:
    """Round pixels between 0 and 1 to integers between 0 and `WHITE`; a thread a pixel."""
    if pixels.device.is_cuda:
        launch(_round, pixels.size, [image.flatten()], [pixels.flatten()])
        return
    rows, elements = pixels.shape[0], pixels.size
    launch_slabs(cpu.round_rows, rows, slabs(rows, elements), [image], [pixels])


@wp.kernel
def _round(
    image: wp.array[float],
    # outputs
    pixels: wp.array[int],
):
    i = wp.tid()
    value = wp.min(wp.max(image[i], 0.0), 1.0)
    pixels[i] = int(wp.floor(value * WHITE + 0.5))


def sample_patches(
    pixels: wp.array, corners: wp.array, side: int, least: int, patches: wp.array
) -> None:
    """Cut out patches and normalise them: mean 0, standard deviation `SPREAD`; a thread a patch.

    `corners` (N, 2) are first pixels. Deviations are (n x - sum x) / R for n pixels, with
    R^2 = n sum x^2 - (sum x)^2. A patch with R < `least` is 0, and so is what is behind its pixels.
    """
    count = corners.shape[0]
    inputs = [pixels, corners, side, wp.int64(least)]
    if patches.device.is_cuda:
        launch(_sample, count, inputs, [patches])
        return
    launch_slabs(cpu.sample, count, slabs(count, patches.size), inputs, [patches])


@wp.func
def _root(square: wp.int64) -> wp.int64:
    """Return the largest integer whose square is not larger."""
    root = wp.int64(wp.sqrt(wp.float64(square)))
    while root * root > square:
        root -= wp.int64(1)
    while (root + wp.int64(1)) * (root + wp.int64(1)) <= square:
        root += wp.int64(1)
    return root


@wp.kernel
def _sample(
    pixels: wp.array2d[int],  # (H, W)
    corners: wp.array2d[int],  # (N, 2)
    side: int,
    least: wp.int64,
    # outputs
    patches: wp.array2d[wp.int8],  # (N, D)
):
    i = wp.tid()
    top = corners[i, 0]
    left = corners[i, 1]
    count = side * side
    total = int(0)
    squares = wp.int64(0)
    for row in range(top, top + side):
        for column in range(left, left + side):
            x = pixels[row, column]
            total += x
            squares += wp.int64(x * x)
    wide = wp.int64(total)
    root = _root(wp.int64(count) * squares - wide * wide)
    scale = SPREAD / wp.float64(wp.max(root, wp.int64(1)))
    for k in range(patches.shape[1]):
        value = int(0)
        if k < count and root >= least:
            row = k // side
            x = count * pixels[top + row, left + k - row * side] - total
            value = int(wp.floor(wp.float64(x) * scale + HALF))
        patches[i, k] = wp.int8(wp.clamp(value, -LARGEST, LARGEST))
