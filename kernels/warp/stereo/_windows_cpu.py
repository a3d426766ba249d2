"""Matching by windows on the CPU: winners among the sums of costs/_windows_cpu.py, row by row.

_windows_cuda.py has the same for CUDA.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Subpixel
from cvkern.kernels.warp._launch import scratch
from cvkern.kernels.warp.stereo.costs._windows_cpu import LANES_OF, padded, row_text

_TILE = 32  # pixels and disparities that are turned over at once

# The sums of a row are turned over: each disparity gets a line of its own, with the pixels side by
# side, and the winner is found for 64 pixels at once. What is no disparity, or outside the image,
# has the sum 65535, which no other is; on both sides a line has `edge` such places.
_TURN = """
    const sums none = (SUM)65535 - (sums){};
    const int edge = LANES, turned = (width + TILE - 1) / TILE * TILE;
    SUM* const tile = turned_sums.data + (size_t)slab * turned_sums.shape[1];
    SUM* const lines_of_sums = tile + TILE * LANES;
    typedef SUM part
        __attribute__((vector_size(TILE * sizeof(SUM)), aligned(sizeof(SUM)), may_alias));
    if (restart)
        for (int k = 0; k < range; ++k)
            for (int i = 0; i < line; ++i)
                if (i < edge || i >= edge + turned) lines_of_sums[(size_t)k * line + i] = 65535;
    const auto turn = [&](int x, int chunk) {
        // Within blocks of 8 x 8, then the blocks. Each round of taking halves by turns moves the
        // first bit of the number of a row to the end of that of a column, and the other way round.
        for (int begin = 0; begin < LANES; begin += TILE) {
            part rows[TILE];
            for (int group = 0; group < TILE; group += 8) {
                part a[8], b[8];
                #pragma clang loop unroll(full)
                for (int i = 0; i < 8; ++i)
                    a[i] = *(part*)(tile + (group + i) * LANES + begin);
                #pragma clang loop unroll(full)
                for (int round = 0; round < 3; ++round) {
                    #pragma clang loop unroll(full)
                    for (int i = 0; i < 4; ++i) {
                        b[2 * i] = __builtin_shufflevector(a[i], a[i + 4], LOW_HALVES);
                        b[2 * i + 1] = __builtin_shufflevector(a[i], a[i + 4], HIGH_HALVES);
                    }
                    #pragma clang loop unroll(full)
                    for (int i = 0; i < 8; ++i) a[i] = b[i];
                }
                #pragma clang loop unroll(full)
                for (int i = 0; i < 8; ++i) rows[group + i] = a[i];
            }
            for (int i = 0; i < 8; ++i) {
                const part a = rows[i], b = rows[i + 8], c = rows[i + 16], d = rows[i + 24];
                const part e = __builtin_shufflevector(a, c, FIRST_BLOCKS);
                const part f = __builtin_shufflevector(a, c, LAST_BLOCKS);
                const part g = __builtin_shufflevector(b, d, FIRST_BLOCKS);
                const part h = __builtin_shufflevector(b, d, LAST_BLOCKS);
                SUM* const to = lines_of_sums + (size_t)(chunk + begin + i) * line + edge + x;
                *(part*)to = __builtin_shufflevector(e, g, FIRST_BLOCKS);
                *(part*)(to + (size_t)8 * line) = __builtin_shufflevector(e, g, LAST_BLOCKS);
                *(part*)(to + (size_t)16 * line) = __builtin_shufflevector(f, h, FIRST_BLOCKS);
                *(part*)(to + (size_t)24 * line) = __builtin_shufflevector(f, h, LAST_BLOCKS);
            }
        }
    };
    sums lane;
    for (int k = 0; k < LANES; ++k) lane[k] = (SUM)k;
"""

_KEEP = """
            const int at = x - 2 * radius_x, row = at % TILE;
            *(sums*)(tile + row * LANES) = lane + (SUM)chunk < (SUM)count ? total : none;
            if (row == TILE - 1 || at == width - 1) {
                for (int i = row + 1; i < TILE; ++i) *(sums*)(tile + i * LANES) = none;
                turn(at - row, chunk);
            }
"""

# The winner of each pixel of the row: the smallest sum, of equal ones the first.
_WINNERS = """
    for (int begin = 0; begin < width; begin += LANES) {
        const SUM* const here = lines_of_sums + edge + begin;
        sums least = none, place = none, second = none;
        for (int k = 0; k < count; ++k) {
            const sums sum = *(const sums*)(here + (size_t)k * line);
            place = sum < least ? (SUM)k - (sums){} : place;
            least = MIN(sum, least);
        }
        for (int k = 0; k < count; ++k) {
            const sums sum = *(const sums*)(here + (size_t)k * line);
            second = (SUM)(k + 1) - place <= (SUM)2 ? second : MIN(sum, second);
        }
        SUM found[3][LANES];
        *(sums*)found[0] = place;
        *(sums*)found[1] = least;
        *(sums*)found[2] = second;
        const int end = width - begin < LANES ? width - begin : LANES;
        for (int i = 0; i < end; ++i) {
            // As `pick` of winners.py.
            const int at = found[0][i], best = found[1][i], rival = found[2][i];
            const size_t pixel = (size_t)y * width + begin + i;
            const bool alone = rival == 65535;
            float certain = alone ? 1.0f : 0.0f;
            if (!alone && rival > best) certain = 1.0f - (float)best / (float)rival;
            cost.data[pixel] = (float)best;
            confidence.data[pixel] = certain;
            if (!alone && rival * (100 - uniqueness) < best * 100) {
                index.data[pixel] = -1;
                disparity.data[pixel] = __builtin_nanf("");
                continue;
            }
            float offset = 0.0f;
            if (subpixel != NONE && at > 0 && at + 1 < count) {
                const SUM* const winner = here + (size_t)at * line + i;
                const int a = winner[-line] - best, b = winner[line] - best;
                const int m = subpixel == PARABOLA ? a + b : a > b ? a : b;
                if (m > 0) offset = 0.5f * ((float)(a - b) / (float)m);
            }
            index.data[pixel] = at;
            disparity.data[pixel] = (float)(start + at) + offset;
        }
    }
    // The same of the right image: its pixel x has the disparity k in common with x + start + k.
    for (int begin = 0; begin < width; begin += LANES) {
        const int first = begin + start;
        const int low = first < -edge ? -edge - first : 0;
        const int high = width - first < count ? width - first : count;
        sums least = none, place = none;
        for (int k = low; k < high; ++k) {
            const sums sum = *(const sums*)(lines_of_sums + (size_t)k * line + edge + first + k);
            place = sum < least ? (SUM)k - (sums){} : place;
            least = MIN(sum, least);
        }
        const int end = width - begin < LANES ? width - begin : LANES;
        SUM found[2][LANES];
        *(sums*)found[0] = place;
        *(sums*)found[1] = least;
        int* const to = right_index.data + (size_t)y * width + begin;
        for (int i = 0; i < end; ++i) to[i] = found[1][i] == 65535 ? -1 : found[0][i];
    }
"""


def turned_scratch(width: int, count: int, slabs: int, device: wp.Device) -> tuple[wp.array, int]:
    """Return the turned sums of a row for each slab, and the length of their lines.

    That is an odd number of cache lines, or all disparities of a pixel would share a few of them.
    """
    lanes = LANES_OF[wp.uint16]
    line = (-(-width // lanes) + 2) * lanes
    line += _TILE * (line // _TILE % 2 == 0)
    size = _TILE * lanes + padded(count, wp.uint16) * line
    return scratch("window.turned", (slabs, size), wp.uint16, device), line


def _by_turns(begins: Iterable[int], size: int, step: int) -> str:
    """Return the places of one vector and of another, by turns, `step` at a time.

    They are the `size` places behind each of `begins`.
    """
    pieces = (range(i, i + step) for begin in begins for i in range(begin, begin + size, step))
    return ", ".join(str(i + other) for piece in pieces for other in (0, _TILE) for i in piece)


def _text(cost: int, pixel: Any) -> str:
    text = row_text(cost, pixel, wp.uint16, _KEEP, before=_TURN, after=_WINNERS)
    for name, value in {
        "LOW_HALVES": _by_turns(range(0, _TILE, 8), 4, 1),
        "HIGH_HALVES": _by_turns(range(4, _TILE, 8), 4, 1),
        "FIRST_BLOCKS": _by_turns([0], _TILE // 2, 8),
        "LAST_BLOCKS": _by_turns([_TILE // 2], _TILE // 2, 8),
        "TILE": _TILE,
        "NONE": int(Subpixel.NONE),
        "PARABOLA": int(Subpixel.PARABOLA),
    }.items():
        text = text.replace(name, str(value))
    return text


@cache
def match_windows(cost: int, pixel: Any) -> wp.Kernel:
    """Return the kernel that matches windows of images of this type, uint8 or uint64."""

    @wp.func_native(_text(cost, pixel))
    def match_row(
        slab: int,
        y: int,
        restart: bool,
        left: wp.array3d[pixel],
        right: wp.array3d[pixel],
        start: int,
        count: int,
        octets: int,
        radius_y: int,
        radius_x: int,
        subpixel: int,
        uniqueness: int,
        lines: wp.array2d[wp.uint8],
        columns: wp.array2d[wp.uint16],
        turned_sums: wp.array2d[wp.uint16],
        line: int,
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        right_index: wp.array2d[int],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def match_windows(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        start: int,
        count: int,
        octets: int,
        radius_y: int,
        radius_x: int,
        subpixel: int,
        uniqueness: int,
        # scratch, (slabs, ...)
        lines: wp.array2d[wp.uint8],  # 2 rows of lines
        columns: wp.array2d[wp.uint16],  # (W + 2 radius_x) padded(D)
        turned_sums: wp.array2d[wp.uint16],  # a tile, and padded(D) lines
        line: int,  # their length
        # outputs, (H, W)
        index: wp.array2d[int],
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
        right_index: wp.array2d[int],
    ):
        for y in range(first, last):
            match_row(
                slab, y, y == first, left, right, start, count, octets, radius_y, radius_x,
                subpixel, uniqueness, lines, columns, turned_sums, line,
                index, disparity, cost, confidence, right_index,
            )  # fmt: skip

    return match_windows
