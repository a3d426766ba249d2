"""Zero-mean normalised cross-correlation on the CPU: the sums of _windows_cpu.py, of products.

With n pixels in a window, and sums S over it, the correlation of the windows l and r is

    (n S(l r) - S(l) S(r)) / sqrt((n S(l l) - S(l)^2) (n S(r r) - S(r)^2))

where each of the three differences is summed over the channels. Float64 holds the sums of bytes
exactly; those of floats have the order of _windows_cpu.py.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import FLAT, Cost

from ._windows_cpu import C_TYPES, row_text

# The sums and the scale, one over the root, of each window with its middle from column -radius_x
# to column W - 1 + radius_x; of other windows they are the same again.
_MOMENTS = """
    #pragma clang fp contract(off)
    const int height = image.shape[0], width = image.shape[1], channels = image.shape[2];
    const int wide = width + 2 * radius_x, wider = wide + 2 * radius_x;
    double* const down = columns.data + (size_t)slab * columns.shape[1];
    double* const down_squares = down + wider;
    double* const energy = down_squares + wider;
    double* const scale = scales.data + (size_t)y * wide;
    const double n = (double)(2 * radius_y + 1) * (2 * radius_x + 1);
    for (int x = 0; x < wide; ++x) scale[x] = energy[x] = 0.0;
    for (int c = 0; c < channels; ++c) {
        for (int x = 0; x < 2 * wider; ++x) down[x] = 0.0;
        for (int v = y - radius_y; v <= y + radius_y; ++v) {
            const int row = v < 0 ? 0 : v < height ? v : height - 1;
            const PIXEL* const from = image.data + (size_t)row * width * channels + c;
            for (int x = 0; x < wider; ++x) {
                const int at = x - 2 * radius_x;
                const double value =
                    from[(size_t)(at < 0 ? 0 : at < width ? at : width - 1) * channels];
                down[x] += value;
                down_squares[x] += value * value;
            }
        }
        double* const sum = sums.data + ((size_t)y * channels + c) * wide;
        for (int x = 0; x < wide; ++x) {
            double total = down[x], squares = down_squares[x];
            for (int u = 1; u <= 2 * radius_x; ++u) {
                total += down[x + u];
                squares += down_squares[x + u];
            }
            sum[x] = total;
            energy[x] += n * squares;
            scale[x] += n * squares - total * total;
        }
    }
    for (int x = 0; x < wide; ++x)
        scale[x] = scale[x] > FLAT * energy[x] ? 1.0 / __builtin_sqrt(scale[x]) : 0.0;
"""

# The sums and scales of the right image, in the order of the disparities of a pixel: as the lines
# of the row, but that each place is the middle of a window.
_BEFORE = """
    const double n = (double)(2 * radius_y + 1) * (2 * radius_x + 1);
    const int moments_pitch = width + range;
    double* const right_scale = moments.data + (size_t)slab * moments.shape[1];
    double* const right_sum = right_scale + moments_pitch;
    for (int i = 0; i < moments_pitch; ++i) {
        int at = width - 1 - start - i + radius_x;
        at = at < 0 ? 0 : at < wide ? at : wide - 1;
        right_scale[i] = right_scales.data[(size_t)y * wide + at];
        for (int c = 0; c < channels; ++c)
            right_sum[(size_t)c * moments_pitch + i] =
                right_sums.data[((size_t)y * channels + c) * wide + at];
    }
"""

_EMIT = """
            typedef double reals
                __attribute__((vector_size(LANES * sizeof(double)), aligned(8), may_alias));
            typedef float outs
                __attribute__((vector_size(LANES * sizeof(float)), aligned(4), may_alias));
            const int place = x - radius_x, at = width - 1 - (x - 2 * radius_x) + chunk;
            reals covariance = n * __builtin_convertvector(total, reals);
            for (int c = 0; c < channels; ++c)
                covariance -= left_sums.data[((size_t)y * channels + c) * wide + place]
                    * *(const reals*)(right_sum + (size_t)c * moments_pitch + at);
            const reals scale = *(const reals*)(right_scale + at);
            reals value = 1.0 - covariance * left_scales.data[(size_t)y * wide + place] * scale;
            value = value < 0.0 ? (reals){} : value;
            value = value > 2.0 ? 2.0 - (reals){} : value;
            const outs rounded = __builtin_convertvector(value, outs);
            float* const to = costs.data + ((size_t)y * width + x - 2 * radius_x) * count + chunk;
            if (chunk + LANES <= count) *(outs*)to = rounded;
            else for (int k = 0; chunk + k < count; ++k) to[k] = rounded[k];
"""


@cache
def moments(pixel: Any) -> wp.Kernel:
    """Return the kernel of the sums and scales of windows, for images of this type."""

    @wp.func_native(_MOMENTS.replace("PIXEL", C_TYPES[pixel]).replace("FLAT", repr(FLAT)))
    def moments_row(
        slab: int,
        y: int,
        image: wp.array3d[pixel],
        radius_y: int,
        radius_x: int,
        columns: wp.array2d[wp.float64],
        sums: wp.array3d[wp.float64],
        scales: wp.array2d[wp.float64],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def moments(
        slab: int,
        first: int,
        last: int,
        image: wp.array3d[pixel],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        # scratch
        columns: wp.array2d[wp.float64],  # (slabs, 3 (W + 4 radius_x))
        # outputs
        sums: wp.array3d[wp.float64],  # (H, C, W + 2 radius_x)
        scales: wp.array2d[wp.float64],  # (H, W + 2 radius_x)
    ):
        for y in range(first, last):
            moments_row(slab, y, image, radius_y, radius_x, columns, sums, scales)

    return moments


@cache
def correlation(pixel: Any) -> wp.Kernel:
    """Return the kernel of the costs, for images of this type."""
    products = wp.float64 if pixel is wp.float32 else wp.int32

    @wp.func_native(row_text(Cost.ZNCC, pixel, products, _EMIT, before=_BEFORE))
    def correlation_row(
        slab: int,
        y: int,
        restart: bool,
        left: wp.array3d[pixel],
        right: wp.array3d[pixel],
        left_sums: wp.array3d[wp.float64],
        right_sums: wp.array3d[wp.float64],
        left_scales: wp.array2d[wp.float64],
        right_scales: wp.array2d[wp.float64],
        start: int,
        count: int,
        octets: int,
        radius_y: int,
        radius_x: int,
        lines: wp.array2d[pixel],
        columns: wp.array2d[products],
        moments: wp.array2d[wp.float64],
        costs: wp.array3d[float],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def correlation(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        left_sums: wp.array3d[wp.float64],  # (H, C, W + 2 radius_x)
        right_sums: wp.array3d[wp.float64],
        left_scales: wp.array2d[wp.float64],  # (H, W + 2 radius_x)
        right_scales: wp.array2d[wp.float64],
        start: int,
        radius_y: int,
        radius_x: int,
        # scratch, (slabs, ...)
        lines: wp.array2d[pixel],  # 2 rows of lines
        columns: wp.array2d[products],  # (W + 2 radius_x) padded(D)
        moments: wp.array2d[wp.float64],  # (1 + C) (W + padded(D))
        # outputs
        costs: wp.array3d[float],  # (H, W, D)
    ):
        for y in range(first, last):
            correlation_row(
                slab, y, y == first, left, right, left_sums, right_sums, left_scales, right_scales,
                start, costs.shape[2], 1, radius_y, radius_x, lines, columns, moments, costs,
            )  # fmt: skip

    return correlation
