"""Census and Hamming distance on the CPU: one thread a slab of rows, a row at a time, in C.

_census_cuda.py has the same for CUDA.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# Comparison n of a pixel goes into byte n / 8 of 64 pixels at once; the bytes are joined behind.
_ROW = """
    const int reach = radius_y * spacing, size = 2 * reach + 1, pitch = lines.shape[1];
    const int margin = radius_x * spacing * step;
    const int columns = bits.shape[1] * step;
    const TYPE* window = lines.data + (size_t)slab * size * pitch + margin;
    unsigned long long* out = (unsigned long long*)bits.data + (size_t)y * columns;
    for (int begin = 0; begin < columns; begin += 64) {
        const int count = columns - begin < 64 ? columns - begin : 64;
        unsigned char bytes[8][64];
        for (int i = 0; i < 8; ++i)
            for (int k = 0; k < 64; ++k) bytes[i][k] = 0;
        const TYPE* centre = window + (size_t)(y % size) * pitch + begin;
        int n = 0;
        for (int dy = -radius_y; dy <= (symmetric ? 0 : radius_y); ++dy)
            for (int dx = -radius_x; dx <= radius_x; ++dx) {
                if (dy == 0 && (symmetric ? dx >= 0 : dx == 0)) continue;
                const int v = dy * spacing, u = dx * spacing * step;
                const int above = (y + v + size) % size, below = (y - v + size) % size;
                const TYPE* a = window + (size_t)above * pitch + begin + u;
                const TYPE* b = centre;
                if (symmetric) b = window + (size_t)below * pitch + begin - u;
                unsigned char* to = bytes[n >> 3];
                const unsigned char bit = (unsigned char)(1 << (n & 7));
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < 64; ++k) to[k] |= a[k] < b[k] ? bit : (unsigned char)0;
                ++n;
            }
        unsigned long long words[64];
        #pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < 64; ++k) words[k] = bytes[0][k];
        for (int i = 1; 8 * i < n; ++i) {
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) words[k] |= (unsigned long long)bytes[i][k] << (8 * i);
        }
        for (int k = 0; k < count; ++k) out[begin + k] = words[k];
    }
"""

# A row of the image, continued on both sides by its outermost pixels.
_LINE = """
    const int pitch = lines.shape[1], margin = reach * step, columns = image.shape[1] * step;
    const TYPE* from = image.data + (size_t)row * columns;
    TYPE* to = lines.data + (size_t)line * pitch;
    for (int i = 0; i < margin; ++i) {
        to[i] = from[i % step];
        to[margin + columns + i] = from[columns - step + i % step];
    }
    #pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < columns; ++i) to[margin + i] = from[i];
"""


def _census(scalar: Any, c_type: str) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.func_native(_ROW.replace("TYPE", c_type))
    def census_row(
        slab: int,
        y: int,
        radius_y: int,
        radius_x: int,
        spacing: int,
        step: int,
        symmetric: int,
        lines: wp.array2d[scalar],
        bits: wp.array3d[wp.uint64],
    ): ...

    @wp.func_native(_LINE.replace("TYPE", c_type))
    def copy_line(
        image: wp.array3d[scalar],
        row: int,
        reach: int,
        step: int,
        line: int,
        lines: wp.array2d[scalar],
    ): ...

    @wp.kernel
    def census(
        slab: int,
        first: int,
        last: int,
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        symmetric: int,
        # scratch
        lines: wp.array2d[scalar],  # (slabs (2 reach + 1), (W + 2 radius_x spacing) C + 64)
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ):
        # Row v stands in line v modulo the size of the window: from row to row, one line is new.
        reach = radius_y * spacing
        size = 2 * reach + 1
        step = image.shape[2]
        for y in range(first, last):
            for v in range(wp.where(y == first, y - reach, y + reach), y + reach + 1):
                inside = wp.clamp(v, 0, image.shape[0] - 1)
                # size * H keeps the remainder of a negative row positive.
                line = slab * size + (v + size * image.shape[0]) % size
                copy_line(image, inside, radius_x * spacing, step, line, lines)
            census_row(slab, y, radius_y, radius_x, spacing, step, symmetric, lines, bits)

    return census


census = {wp.uint8: _census(wp.uint8, "unsigned char"), wp.float32: _census(wp.float32, "float")}


@wp.func_native("""
    const int width = right.shape[1], step = right.shape[2], pitch = lines.shape[1];
    const unsigned long long* from =
        (const unsigned long long*)right.data + (size_t)y * width * step;
    unsigned long long* to = (unsigned long long*)lines.data + (size_t)slab * step * pitch;
    for (int c = 0; c < step; ++c)
        for (int i = 0; i < pitch; ++i) {
            const int x = width - 1 - start - i;
            to[(size_t)c * pitch + i] = from[(x < 0 ? 0 : x < width ? x : width - 1) * step + c];
        }
""")
def reverse_row(
    slab: int,
    y: int,
    start: int,
    right: wp.array3d[wp.uint64],
    lines: wp.array2d[wp.uint64],
): ...


@wp.func_native("""
    const int width = left.shape[1], step = left.shape[2], pitch = lines.shape[1];
    const int range = costs.shape[2];
    const unsigned long long* pixel =
        (const unsigned long long*)left.data + (size_t)y * width * step;
    const unsigned long long* line =
        (const unsigned long long*)lines.data + (size_t)slab * step * pitch;
    for (int x = 0; x < width; ++x) {
        unsigned char* out = costs.data + ((size_t)y * width + x) * range;
        for (int c = 0; c < step; ++c) {
            const unsigned long long bits = pixel[x * step + c];
            const unsigned long long* other = line + (size_t)c * pitch + width - 1 - x;
            if (c == 0) {
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < range; ++k)
                    out[k] = (unsigned char)__builtin_popcountll(bits ^ other[k]);
            } else {
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < range; ++k)
                    out[k] += (unsigned char)__builtin_popcountll(bits ^ other[k]);
            }
        }
    }
""")
def hamming_row(
    slab: int,
    y: int,
    left: wp.array3d[wp.uint64],
    lines: wp.array2d[wp.uint64],
    costs: wp.array3d[wp.uint8],
): ...


@wp.kernel
def hamming(
    slab: int,
    first: int,
    last: int,
    left: wp.array3d[wp.uint64],  # (H, W, C)
    right: wp.array3d[wp.uint64],  # (H, W, C)
    start: int,
    # scratch
    lines: wp.array2d[wp.uint64],  # (slabs C, W + D - 1)
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
):
    # Of the reversed row, the partners of a pixel stand in the order of their disparities.
    for y in range(first, last):
        reverse_row(slab, y, start, right, lines)
        hamming_row(slab, y, left, lines, costs)
