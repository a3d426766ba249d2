"""Matching costs summed over windows on CUDA: down the columns, then along the rows.

A strip of rows at a time, so that the sums between the two passes stay in the cache. A thread walks
down some rows, or along some columns, of one disparity; the disparities of a pixel are neighbouring
threads. Sums of integers run; those of floats are made anew, in the order of _windows_cpu.py.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import FLAT, Cost
from cvkern.kernels.warp._launch import launch, scratch

from ._windows_cpu import C_TYPES

_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)

_BLOCK = 256
_DOWN, _ALONG = 16, 64  # sums that one thread makes
_STRIP_BYTES = 24 << 20  # half the second cache of the largest GPUs

# The cost of two values; `total` is an integer, or of the type of the sums.
_COSTS = {
    Cost.SAD: "total += a < b ? b - a : a - b;",
    Cost.SSD: "total += (a - b) * (a - b);",
    Cost.CENSUS: "total += __popcll(a ^ b);",
    Cost.ZNCC: "total += (SUM)a * (SUM)b;",
    Cost.BIRCHFIELD_TOMASI: """
                const VALUE a0 = (__ldg(l + left_before) + a) / 2;
                const VALUE a1 = (a + __ldg(l + left_behind)) / 2;
                const VALUE b0 = (__ldg(r + right_before) + b) / 2;
                const VALUE b1 = (b + __ldg(r + right_behind)) / 2;
                const VALUE over = max(b - max(a, max(a0, a1)), min(a, min(a0, a1)) - b);
                const VALUE under = max(a - max(b, max(b0, b1)), min(b, min(b0, b1)) - a);
                total += max((VALUE)0, min(over, under));""",
}

_SUM_DOWN = """
    const int height = left.shape[0], width = left.shape[1], channels = left.shape[2];
    const int rows = sums.shape[0], wide = sums.shape[1], depth = sums.shape[2];
    const unsigned columns = (unsigned)wide * depth, blocks = (columns - 1) / BLOCK + 1;
    const unsigned i = blockIdx.x % blocks * BLOCK + threadIdx.x;
    if (i >= columns) return;
    const int begin = blockIdx.x / blocks * DOWN, end = min(begin + DOWN, rows);
    const int x = (int)(i / depth) - radius_x, partner = x - first - (int)(i % depth);
    const auto inside = [&](int column) { return max(0, min(width - 1, column)) * channels; };
    const int left_here = inside(x), right_here = inside(partner);
    const int left_before = inside(x - 1) - left_here, left_behind = inside(x + 1) - left_here;
    const int right_before = inside(partner - 1) - right_here;
    const int right_behind = inside(partner + 1) - right_here;
    const auto cost_of = [&](int y) {
        const size_t row = (size_t)max(0, min(height - 1, y)) * width * channels;
        const PIXEL* l = (const PIXEL*)left.data + row + left_here;
        const PIXEL* r = (const PIXEL*)right.data + row + right_here;
        SUM total = 0;
        for (int c = 0; c < channels; ++c, ++l, ++r) {
            const VALUE a = __ldg(l), b = __ldg(r);
            COST
        }
        return total;
    };
    const auto sum_of = [&](int y) {
        SUM down = 0;
        #pragma unroll 4
        for (int v = y - radius_y; v <= y + radius_y; ++v) down += cost_of(v);
        return down;
    };
    KEPT* to = sums.data + (size_t)begin * columns + i;
    SUM down = sum_of(top + begin);
    *to = down;
    // Loads through __ldg wait for no store, so that those of several rounds are on their way.
    #pragma unroll UNROLL
    for (int y = top + begin + 1; y < top + end; ++y) {
        if (FLOATS || radius_y == 0) down = sum_of(y);
        else down += cost_of(y + radius_y) - cost_of(y - radius_y - 1);
        *(to += columns) = down;
    }
"""

_SUM_ALONG = """
    const int width = costs.shape[1], depth = costs.shape[2];
    const int runs = (width + ALONG - 1) / ALONG;
    const unsigned places = (unsigned)runs * depth, blocks = (places - 1) / BLOCK + 1;
    const unsigned i = blockIdx.x % blocks * BLOCK + threadIdx.x;
    if (i >= places) return;
    const int row = blockIdx.x / blocks, y = top + row, k = i % depth;
    const int begin = i / depth * ALONG, end = min(begin + ALONG, width);
    const KEPT* from = sums.data + ((size_t)row * sums.shape[1] + begin) * depth + k;
    const size_t newest = (size_t)2 * radius_x * depth;
    BEGIN
    SUM total = 0;
    #pragma unroll UNROLL
    for (int x = begin; x < end; ++x, from += depth) {
        if (FLOATS || x == begin || radius_x == 0) {
            total = __ldg(from);
            #pragma unroll 4
            for (size_t u = depth; u <= newest; u += depth) total += __ldg(from + u);
        } else {
            total += (SUM)__ldg(from + newest) - (SUM)__ldg(from - depth);
        }
        const size_t to = ((size_t)y * width + x) * depth + k;
        EMIT
    }
"""

# As in _correlation_cpu.py.
_BEGIN = """
    const int channels = left_sums.shape[2], wide = sums.shape[1];
    const size_t line = (size_t)y * wide;
"""
_CORRELATE = """
        const size_t place = line + x + radius_x;
        const size_t other = line + max(0, min(wide - 1, x + radius_x - first - k));
        double covariance = n * (double)total;
        for (int c = 0; c < channels; ++c)
            covariance -= left_sums.data[place * channels + c]
                * right_sums.data[other * channels + c];
        const double value =
            1.0 - covariance * left_scales.data[place] * right_scales.data[other];
        costs.data[to] = (float)(value < 0.0 ? 0.0 : value > 2.0 ? 2.0 : value);
"""

_MOMENTS_DOWN = """
    const int height = image.shape[0], columns = image.shape[1] * image.shape[2];
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    if (i >= (unsigned)height * columns) return;
    const int y = i / columns, x = i % columns;
    double total = 0.0, square = 0.0;
    for (int v = y - radius_y; v <= y + radius_y; ++v) {
        const double value = image.data[(size_t)max(0, min(height - 1, v)) * columns + x];
        total += value;
        square += value * value;
    }
    sums.data[i] = total;
    squares.data[i] = square;
"""

_MOMENTS_ALONG = """
    const int height = down.shape[0], width = down.shape[1], channels = down.shape[2];
    const int wide = sums.shape[1];
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    if (i >= (unsigned)height * wide) return;
    const int y = i / wide, j = i % wide;
    double energy = 0.0, spread = 0.0;
    for (int c = 0; c < channels; ++c) {
        double total = 0.0, square = 0.0;
        for (int u = j - 2 * radius_x; u <= j; ++u) {
            const size_t at = ((size_t)y * width + max(0, min(width - 1, u))) * channels + c;
            total += down.data[at];
            square += down_squares.data[at];
        }
        sums.data[(size_t)i * channels + c] = total;
        energy += n * square;
        spread += n * square - total * total;
    }
    scales.data[i] = spread > FLAT * energy ? __ddiv_rn(1.0, __dsqrt_rn(spread)) : 0.0;
"""

_PIXELS = {wp.uint8: "unsigned char", wp.float32: "float", wp.uint64: "unsigned long long"}
_VALUES = _PIXELS | {wp.uint8: "int"}


def _text(source: str, pixel: Any, kept: Any, cost: int = Cost.SAD, emit: str = "") -> str:
    floats = kept in (wp.float32, wp.float64)
    begin = _BEGIN if cost == Cost.ZNCC else ""
    for name, value in {
        "EMIT": emit,
        "BEGIN": begin,
        "COST": _COSTS[Cost(cost)],
        "BLOCK": str(_BLOCK),
        "DOWN": str(_DOWN),
        "ALONG": str(_ALONG),
        "FLOATS": "true" if floats else "false",
        "UNROLL": "1" if floats else "8",
        "FLAT": repr(FLAT),
        "PIXEL": _PIXELS[pixel],
        "VALUE": _VALUES[pixel],
        "SUM": C_TYPES[kept] if floats else "int",
        "KEPT": C_TYPES[kept],
    }.items():
        source = source.replace(name, value)
    return source


@lru_cache
def sum_down(cost: int, pixel: Any, kept: Any) -> wp.Kernel:
    """Return the kernel of a cost, which is compiled when it is first used."""

    @wp.func_native(_text(_SUM_DOWN, pixel, kept, cost))
    def sum_column(
        left: wp.array3d[pixel],
        right: wp.array3d[pixel],
        first: int,
        radius_y: int,
        radius_x: int,
        top: int,
        sums: wp.array3d[kept],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def sum_down(
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        first: int,
        radius_y: int,
        radius_x: int,
        top: int,
        # outputs
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
    ):
        sum_column(left, right, first, radius_y, radius_x, top, sums)

    return sum_down


@lru_cache
def sum_along(kept: Any, out: Any) -> wp.Kernel:
    """Return the kernel for sums and costs of these types."""
    store = f"costs.data[to] = ({C_TYPES[out]})total;"

    @wp.func_native(_text(_SUM_ALONG, wp.uint8, kept, emit=store))
    def sum_row(sums: wp.array3d[kept], radius_x: int, top: int, costs: wp.array3d[out]): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def sum_along(
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
        radius_x: int,
        top: int,
        # outputs
        costs: wp.array3d[out],  # (H, W, D)
    ):
        sum_row(sums, radius_x, top, costs)

    return sum_along


@lru_cache
def correlate_along(kept: Any) -> wp.Kernel:
    """Return the kernel for sums of products of this type."""

    @wp.func_native(_text(_SUM_ALONG, wp.uint8, kept, Cost.ZNCC, _CORRELATE))
    def correlate_row(
        sums: wp.array3d[kept],
        left_sums: wp.array3d[wp.float64],
        right_sums: wp.array3d[wp.float64],
        left_scales: wp.array2d[wp.float64],
        right_scales: wp.array2d[wp.float64],
        first: int,
        n: wp.float64,
        radius_x: int,
        top: int,
        costs: wp.array3d[float],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def correlate_along(
        sums: wp.array3d[kept],  # (rows of the strip, W + 2 radius_x, D)
        left_sums: wp.array3d[wp.float64],  # (H, W + 2 radius_x, C)
        right_sums: wp.array3d[wp.float64],
        left_scales: wp.array2d[wp.float64],  # (H, W + 2 radius_x)
        right_scales: wp.array2d[wp.float64],
        first: int,
        n: wp.float64,
        radius_x: int,
        top: int,
        # outputs
        costs: wp.array3d[float],  # (H, W, D)
    ):
        correlate_row(
            sums, left_sums, right_sums, left_scales, right_scales, first, n, radius_x, top, costs
        )

    return correlate_along


@lru_cache
def moments_down(pixel: Any) -> wp.Kernel:
    """Return the kernel for images of this type."""

    @wp.func_native(_text(_MOMENTS_DOWN, pixel, wp.float64))
    def moments_of_column(
        image: wp.array3d[pixel],
        radius_y: int,
        sums: wp.array3d[wp.float64],
        squares: wp.array3d[wp.float64],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def moments_down(
        image: wp.array3d[pixel],  # (H, W, C)
        radius_y: int,
        # outputs, (H, W, C)
        sums: wp.array3d[wp.float64],
        squares: wp.array3d[wp.float64],
    ):
        moments_of_column(image, radius_y, sums, squares)

    return moments_down


@wp.func_native(_text(_MOMENTS_ALONG, wp.uint8, wp.float64))
def moments_of_row(
    down: wp.array3d[wp.float64],
    down_squares: wp.array3d[wp.float64],
    radius_x: int,
    n: wp.float64,
    sums: wp.array3d[wp.float64],
    scales: wp.array2d[wp.float64],
): ...


@wp.kernel
def moments_along(
    down: wp.array3d[wp.float64],  # (H, W, C)
    down_squares: wp.array3d[wp.float64],
    radius_x: int,
    n: wp.float64,
    # outputs
    sums: wp.array3d[wp.float64],  # (H, W + 2 radius_x, C)
    scales: wp.array2d[wp.float64],  # (H, W + 2 radius_x)
):
    moments_of_row(down, down_squares, radius_x, n, sums, scales)


def window_costs(
    left: wp.array,
    right: wp.array,
    first: int,
    cost: int,
    radius_y: int,
    radius_x: int,
    costs: wp.array,
    *,
    begin: int = 0,
) -> None:
    """Fill the costs of the rows from `begin` on."""
    kept = _kept(cost, left.dtype, costs.dtype)
    for top, sums in _strips(costs, radius_x, kept):
        inputs = [left, right, first, radius_y, radius_x, begin + top]
        _launch_down(sum_down(cost, left.dtype, kept), inputs, sums)
        _launch_along(sum_along(kept, costs.dtype), [sums, radius_x, top], sums, costs)


def correlation(
    left: wp.array, right: wp.array, first: int, radius_y: int, radius_x: int, costs: wp.array
) -> None:
    """Sum the images and their products, and fill the costs."""
    height, width, channels = left.shape
    wide, device = width + 2 * radius_x, left.device
    n = float((2 * radius_y + 1) * (2 * radius_x + 1))
    down = [scratch(f"zncc.{name}", left.shape, wp.float64, device) for name in ("sums", "squares")]
    sums, scales = [], []
    for name, image in (("left", left), ("right", right)):
        launch(moments_down(left.dtype), _threads(left.size), [image, radius_y], down)
        sums.append(scratch(f"zncc.{name}_sums", (height, wide, channels), wp.float64, device))
        scales.append(scratch(f"zncc.{name}_scales", (height, wide), wp.float64, device))
        outputs = [sums[-1], scales[-1]]
        launch(moments_along, _threads(height * wide), [*down, radius_x, n], outputs)
    kept = _kept(Cost.ZNCC, left.dtype, costs.dtype)
    for top, products in _strips(costs, radius_x, kept):
        inputs = [left, right, first, radius_y, radius_x, top]
        _launch_down(sum_down(Cost.ZNCC, left.dtype, kept), inputs, products)
        inputs = [products, *sums, *scales, first, n, radius_x, top]
        _launch_along(correlate_along(kept), inputs, products, costs)


def _kept(cost: int, pixel: Any, out: Any) -> Any:
    """Return the type in which sums of columns are kept."""
    if pixel is wp.float32:
        return wp.float64 if cost == Cost.ZNCC else wp.float32
    return wp.int32 if out is wp.float32 else wp.uint16


def _strips(costs: wp.array, radius_x: int, kept: Any) -> Iterator[tuple[int, wp.array]]:
    """Yield the first row of each strip, and scratch memory for its sums down the columns."""
    height, width, depth = costs.shape
    row = (width + 2 * radius_x) * depth * wp.types.type_size_in_bytes(kept)
    rows = min(height, max(_DOWN, _STRIP_BYTES // row // _DOWN * _DOWN))
    for top in range(0, height, rows):
        shape = (min(rows, height - top), width + 2 * radius_x, depth)
        yield top, scratch("window.sums", shape, kept, costs.device)


def _launch_down(kernel: wp.Kernel, inputs: list[Any], sums: wp.array) -> None:
    rows, wide, depth = sums.shape
    launch(kernel, _threads(wide * depth) * -(-rows // _DOWN), inputs, [sums])


def _launch_along(kernel: wp.Kernel, inputs: list[Any], sums: wp.array, costs: wp.array) -> None:
    runs = -(-costs.shape[1] // _ALONG)
    launch(kernel, _threads(runs * costs.shape[2]) * sums.shape[0], inputs, [costs])


def _threads(count: int) -> int:
    """Return the threads of the blocks that `count` threads fill."""
    return -(-count // _BLOCK) * _BLOCK
