"""Census and Hamming distance on CUDA: one thread per pixel, and threads along the disparities.

census.py describes the transform. The code of the distances is native, so that a block stores those
of a tile in order. So is the census of semi-global matching, because the kernel of any window took
91 us for 1080p on an H200.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch

from ._windows_cpu import OPTIONS

_BLOCK = 256
_TILE = 16  # pixels whose distances a block computes


@lru_cache
def census_kernel(scalar: Any, symmetric: bool) -> wp.Kernel:
    """Return the kernel of a census of values of one type; it is compiled at the first use."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def census(
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ):
        y, x, c = wp.tid()
        last_y = image.shape[0] - 1
        last_x = image.shape[1] - 1
        word = wp.uint64(0)
        n = wp.uint64(0)
        centre = image[y, x, c]
        for dy in range(-radius_y, radius_y + 1):
            v = wp.clamp(y + dy * spacing, 0, last_y)
            for dx in range(-radius_x, radius_x + 1):
                u = wp.clamp(x + dx * spacing, 0, last_x)
                if wp.static(symmetric):
                    if dy < 0 or (dy == 0 and dx < 0):
                        opposite_v = wp.clamp(y - dy * spacing, 0, last_y)
                        opposite_u = wp.clamp(x - dx * spacing, 0, last_x)
                        if image[v, u, c] < image[opposite_v, opposite_u, c]:
                            word = word | (wp.uint64(1) << n)
                        n += wp.uint64(1)
                else:
                    if dy != 0 or dx != 0:
                        if image[v, u, c] < centre:
                            word = word | (wp.uint64(1) << n)
                        n += wp.uint64(1)
        bits[y, x, c] = word

    return census


@_native.kernel("_census_cuda.cu", OPTIONS)
def census_of_24(
    image: wp.array3d[wp.uint8],  # (H, W, 1)
    # outputs
    bits: wp.array3d[wp.uint64],  # (H, W, 1)
): ...


@_native.kernel("_census_cuda.cu", OPTIONS, BLOCK=_BLOCK, TILE=_TILE)
def distances(
    left: wp.array3d[wp.uint64],  # (H, W, C)
    right: wp.array3d[wp.uint64],  # (H, W, C)
    first: int,
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
): ...


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Launch a thread for each value; for bytes and the 24 neighbours of matching, for four."""
    usual = radius_y == radius_x == 2 and spacing == 1 and not symmetric
    if usual and image.dtype is wp.uint8 and image.shape[2] == 1:
        launch(census_of_24, image.shape[0] * -(-image.shape[1] // 4), [image], [bits])
        return
    inputs = [image, radius_y, radius_x, spacing]
    launch(census_kernel(image.dtype, bool(symmetric)), image.shape, inputs, [bits])


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Launch a block for each tile of a row."""
    blocks = left.shape[0] * -(-left.shape[1] // _TILE)
    launch(distances, blocks * _BLOCK, [left, right, first], [costs])
