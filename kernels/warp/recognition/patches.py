"""Normalised patches of an image, in Warp: integers throughout."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _patches_cpu as cpu
from . import _patches_cuda as cuda


def sample_patches(
    image: wp.array, corners: wp.array, side: int, least: int, patches: wp.array
) -> None:
    """Cut out patches and normalise them: mean 0, standard deviation `SPREAD`.

    `image` (P,) has the pixels of all levels behind one another; `corners` (N, 2) are the first
    pixel of each patch and the length of its rows. Pixels between 0 and 1 are rounded to integers
    between 0 and `WHITE`. Deviations are (n x - sum x) / R for n pixels, with
    R^2 = n sum x^2 - (sum x)^2, halves rounded up. A patch with R < `least` is 0, and so is what
    is behind its pixels.

    A quotient by R < 2^24 that is no multiple of 1 / 2 is at least 2^-25 from one, and is computed
    to 2^-40: adding 1 / 2 + 2^-30 before it is rounded down makes no difference but to multiples.
    """
    count = corners.shape[0]
    if patches.device.is_cuda:
        inputs = [image, corners, side, wp.int64(least)]
        launch(cuda.sample, count * cuda.LANES, inputs, [patches])
        return
    pixels = scratch("recognition.pixels", image.shape, wp.int32, image.device)
    elements = pixels.size
    launch_slabs(cpu.round_pixels, elements, slabs(elements, elements), [image], [pixels])
    inputs = [pixels, corners, side, wp.int64(least)]
    launch_slabs(cpu.sample, count, slabs(count, patches.size), inputs, [patches])
