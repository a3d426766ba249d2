"""Census and Hamming distance on CUDA: a thread a pixel, and threads along the disparities."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch

from ._windows_cpu import C_TYPES

_OPTIONS = {"enable_backward": False}
wp.set_module_options(_OPTIONS)

_BLOCK = 256
_TILE = 16  # pixels whose distances a block counts

_CENSUS = """
    const int height = image.shape[0], width = image.shape[1], channels = image.shape[2];
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    if (i >= (unsigned)height * width * channels) return;
    const unsigned pixel = i / channels;
    const int c = i % channels, y = pixel / width, x = pixel % width;
    const int reach_y = radius_y * spacing, reach_x = radius_x * spacing;
    const bool inside =
        y >= reach_y && y + reach_y < height && x >= reach_x && x + reach_x < width;
    const TYPE* const centre = image.data + i;
    const auto at = [&](int v, int u) {
        if (inside) return centre[(v * width + u) * channels];
        const int row = max(0, min(height - 1, y + v)), column = max(0, min(width - 1, x + u));
        return image.data[((size_t)row * width + column) * channels + c];
    };
    unsigned long long word = 0;
    int n = 0;
    for (int dy = -radius_y; dy <= (symmetric ? 0 : radius_y); ++dy)
        for (int dx = -radius_x; dx <= radius_x; ++dx) {
            if (dy == 0 && (symmetric ? dx >= 0 : dx == 0)) continue;
            const int v = dy * spacing, u = dx * spacing;
            const bool below = at(v, u) < (symmetric ? at(-v, -u) : *centre);
            word |= (unsigned long long)below << n++;
        }
    bits.data[i] = word;
"""

_HAMMING = """
    const int width = left.shape[1], channels = left.shape[2], depth = costs.shape[2];
    const int tiles = (width + TILE - 1) / TILE, y = blockIdx.x / tiles;
    const int begin = blockIdx.x % tiles * TILE, end = min(begin + TILE, width);
    const size_t row = (size_t)y * width * channels;
    const unsigned long long* const l = (const unsigned long long*)left.data + row;
    const unsigned long long* const r = (const unsigned long long*)right.data + row;
    int x = begin + threadIdx.x / depth, k = threadIdx.x % depth;
    const int step_x = BLOCK / depth, step_k = BLOCK % depth, count = (end - begin) * depth;
    #pragma unroll 4
    for (int i = threadIdx.x; i < count; i += BLOCK) {
        const int partner = max(0, min(width - 1, x - first - k));
        int total = 0;
        for (int c = 0; c < channels; ++c)
            total += __popcll(__ldg(l + x * channels + c) ^ __ldg(r + partner * channels + c));
        costs.data[((size_t)y * width + x) * depth + k] = total;
        x += step_x;
        k += step_k;
        if (k >= depth) {
            k -= depth;
            ++x;
        }
    }
"""


@lru_cache
def census_kernel(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type, which is compiled when it is first used."""

    @wp.func_native(_CENSUS.replace("BLOCK", str(_BLOCK)).replace("TYPE", C_TYPES[scalar]))
    def census_of_pixel(
        image: wp.array3d[scalar],
        radius_y: int,
        radius_x: int,
        spacing: int,
        symmetric: bool,
        bits: wp.array3d[wp.uint64],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def census(
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        symmetric: bool,
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ):
        census_of_pixel(image, radius_y, radius_x, spacing, symmetric, bits)

    return census


@wp.func_native(_HAMMING.replace("BLOCK", str(_BLOCK)).replace("TILE", str(_TILE)))
def distances_of_tile(
    left: wp.array3d[wp.uint64],
    right: wp.array3d[wp.uint64],
    first: int,
    costs: wp.array3d[wp.uint8],
): ...


@wp.kernel
def hamming_kernel(
    left: wp.array3d[wp.uint64],  # (H, W, C)
    right: wp.array3d[wp.uint64],  # (H, W, C)
    first: int,
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
):
    distances_of_tile(left, right, first, costs)


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Launch a thread for each value."""
    count = -(-image.size // _BLOCK) * _BLOCK
    inputs = [image, radius_y, radius_x, spacing, symmetric]
    launch(census_kernel(image.dtype), count, inputs, [bits])


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Launch a block for each tile of a row."""
    blocks = left.shape[0] * -(-left.shape[1] // _TILE)
    launch(hamming_kernel, blocks * _BLOCK, [left, right, first], [costs])
