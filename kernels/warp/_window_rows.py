"""Matching costs summed over windows on the CPU: one thread a slab of rows, in C.

The sums down the columns of the windows are kept for one row of the image, a run of disparities in
a vector; from one row to the next, one row of costs comes and one goes. Summed along the row in
the same way they give the windows. Sums of integers are the same in every order; those of floats
are made anew for every pixel, each column from its top down, then the columns from left to right.
_window_blocks.py has the same for CUDA.
"""

from functools import cache
from typing import Any

import warp as wp

from ..codes import Cost

LANES = {"unsigned short": 64, "int": 32, "float": 32}  # disparities at once, by the type of sums

# The cost of a value: of vectors of PIXEL, `a` of the left image and `b` of the right, and of each
# the least and the largest value between its pixel and half way to the neighbours.
_COSTS = {
    Cost.SAD: """
                const pixels d = a < b ? b - a : a - b;
                total += __builtin_convertvector(d, sums);""",
    Cost.SSD: """
                const sums d = __builtin_convertvector(a < b ? b - a : a - b, sums);
                total += d * d;""",
    Cost.BIRCHFIELD_TOMASI: """
                const pixels over = MAX(a, b_high) - b_high, under = MAX(a, b_low) - a;
                const pixels back = MAX(b, a_high) - a_high, down = MAX(b, a_low) - b;
                const pixels d = MIN(MAX(over, under), MAX(back, down));
                total += __builtin_convertvector(d, sums);""",
}
_COSTS[Cost.BIRCHFIELD_TOMASI] = (
    _COSTS[Cost.BIRCHFIELD_TOMASI]
    .replace("MAX", "__builtin_elementwise_max")
    .replace("MIN", "__builtin_elementwise_min")
)

# Lines of one row of both images, continued on both sides by their outermost pixels: of each
# channel the values, then, where a cost asks for them, the lows and the highs. Lines of the right
# image are reversed, so that the partners of a pixel stand in the order of their disparities.
_LINES = """
    #pragma clang fp contract(off)
    const int height = left.shape[0], width = left.shape[1], channels = left.shape[2];
    const int range = (costs.shape[2] + LANES - 1) / LANES * LANES;
    const int wide = width + 2 * radius_x;
    // One place more on each side, for the neighbours of the outermost.
    const int left_pitch = wide + 2, right_pitch = wide + range + 2;
    const size_t right_lines = (size_t)PLANES * channels * left_pitch;
    const size_t row_lines = right_lines + (size_t)PLANES * channels * right_pitch;
    PIXEL* const slab_lines = lines.data + (size_t)slab * lines.shape[1];
    const auto put = [&](PIXEL* to, int count, const PIXEL* from, int x, int step) {
        // Place i has column x + step i: those of places `first` to `last` are in the image.
        int first = step > 0 ? -x : x - width + 1, last = step > 0 ? width - x : x + 1;
        first = first < 0 ? 0 : first < count ? first : count;
        last = last < first ? first : last < count ? last : count;
        const PIXEL least = from[0], most = from[(size_t)(width - 1) * channels];
        for (int i = 0; i < first; ++i) to[i] = step > 0 ? least : most;
        for (int i = last; i < count; ++i) to[i] = step > 0 ? most : least;
        if (channels > 1) {
            for (int i = first; i < last; ++i) to[i] = from[(size_t)(x + step * i) * channels];
        } else if (step > 0) {
            #pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = from[x + i];
        } else {
            #pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = from[x - i];
        }
        if (PLANES == 1) return;
        PIXEL* const low = to + (size_t)channels * count;
        PIXEL* const high = low + (size_t)channels * count;
        low[0] = low[count - 1] = high[0] = high[count - 1] = 0;
        #pragma clang loop vectorize(assume_safety)
        for (int i = 1; i < count - 1; ++i) {
            const PIXEL here = to[i], one = (to[i - 1] + here) / 2, two = (here + to[i + 1]) / 2;
            const PIXEL least = one < two ? one : two, most = one < two ? two : one;
            low[i] = here < least ? here : least;
            high[i] = here < most ? most : here;
        }
    };
    const auto put_row = [&](int row, int place) {
        row = row < 0 ? 0 : row < height ? row : height - 1;
        PIXEL* const to = slab_lines + place * row_lines;
        const size_t begin = (size_t)row * width * channels;
        for (int c = 0; c < channels; ++c) {
            put(to + (size_t)c * left_pitch, left_pitch, left.data + begin + c, -radius_x - 1, 1);
            put(to + right_lines + (size_t)c * right_pitch, right_pitch, right.data + begin + c,
                width + radius_x - start, -1);
        }
    };
"""

_SUMS = """
    typedef PIXEL pixels
        __attribute__((vector_size(LANES * sizeof(PIXEL)), aligned(sizeof(PIXEL)), may_alias));
    typedef SUM sums
        __attribute__((vector_size(LANES * sizeof(SUM)), aligned(sizeof(SUM)), may_alias));
    // The costs of place x of the lines, for the disparities from `chunk` on.
    const auto cost_of = [&](int place, int x, int chunk) {
        const PIXEL* lefts = slab_lines + place * row_lines + 1 + x;
        const PIXEL* rights = slab_lines + place * row_lines + right_lines + wide - x + chunk;
        sums total = {};
        for (int c = 0; c < channels; ++c, lefts += left_pitch, rights += right_pitch) {
            const pixels a = lefts[0] - (pixels){};
            const pixels b = *(const pixels*)rights;
            if (PLANES == 3) {
                const size_t left_plane = (size_t)channels * left_pitch;
                const size_t right_plane = (size_t)channels * right_pitch;
                const pixels a_low = lefts[left_plane] - (pixels){};
                const pixels a_high = lefts[2 * left_plane] - (pixels){};
                const pixels b_low = *(const pixels*)(rights + right_plane);
                const pixels b_high = *(const pixels*)(rights + 2 * right_plane);
                COST
            } else {
                const pixels a_low = a, a_high = a, b_low = b, b_high = b;
                COST
            }
        }
        return total;
    };
    SUM* const slab_columns = columns.data + (size_t)slab * columns.shape[1];
    const bool anew = FLOATS || restart;
    if (anew) {
        for (size_t i = 0; i < (size_t)wide * range; ++i) slab_columns[i] = 0;
        for (int v = y - radius_y; v < y + radius_y; ++v) {
            put_row(v, 0);
            for (int chunk = 0; chunk < range; chunk += LANES)
                for (int x = 0; x < wide; ++x)
                    *(sums*)(slab_columns + (size_t)wide * chunk + x * LANES) +=
                        cost_of(0, x, chunk);
        }
    } else {
        put_row(y - radius_y - 1, 1);
    }
    put_row(y + radius_y, 0);
    for (int chunk = 0; chunk < range; chunk += LANES) {
        SUM* const column = slab_columns + (size_t)wide * chunk;
        sums total = {};
        for (int x = 0; x < wide; ++x) {
            sums* const here = (sums*)(column + x * LANES);
            sums sum = *here + cost_of(0, x, chunk);
            if (!anew) sum -= cost_of(1, x, chunk);
            *here = sum;
            total += sum;
            if (x < 2 * radius_x) continue;
            const SUM* const oldest = column + (x - 2 * radius_x) * LANES;
            if (FLOATS) {
                total = *(const sums*)oldest;
                for (int i = 1; i <= 2 * radius_x; ++i)
                    total += *(const sums*)(oldest + i * LANES);
            }
            EMIT
            total -= *(const sums*)oldest;
        }
    }
"""

_STORE = """
            typedef OUT outs
                __attribute__((vector_size(LANES * sizeof(OUT)), aligned(sizeof(OUT)), may_alias));
            const outs value = __builtin_convertvector(total, outs);
            OUT* const to = costs.data
                + ((size_t)y * width + x - 2 * radius_x) * costs.shape[2] + chunk;
            if (chunk + LANES <= costs.shape[2]) *(outs*)to = value;
            else for (int k = 0; chunk + k < costs.shape[2]; ++k) to[k] = value[k];
"""

_C_TYPES = {
    wp.uint8: "unsigned char",
    wp.uint16: "unsigned short",
    wp.int32: "int",
    wp.float32: "float",
}


def sums_dtype(pixel: Any, out: Any) -> Any:
    """Return the type of sums that hold what `out` holds."""
    if pixel is wp.float32:
        return wp.float32
    return wp.int32 if out is wp.float32 else wp.uint16


def lanes(sums: Any) -> int:
    """Return how many disparities are taken at once."""
    return LANES[_C_TYPES[sums]]


@cache
def window_costs(cost: int, pixel: Any, out: Any) -> wp.Kernel:
    """Return the kernel of a cost, for images and costs of these types."""
    sum_type = sums_dtype(pixel, out)
    text = (_LINES + _SUMS).replace("EMIT", _STORE).replace("COST", _COSTS[Cost(cost)])
    for name, value in {
        "PLANES": "3" if cost == Cost.BIRCHFIELD_TOMASI else "1",
        "FLOATS": "true" if pixel is wp.float32 else "false",
        "LANES": str(lanes(sum_type)),
        "PIXEL": _C_TYPES[pixel],
        "SUM": _C_TYPES[sum_type],
        "OUT": _C_TYPES[out],
    }.items():
        text = text.replace(name, value)

    @wp.func_native(text)
    def window_row(
        slab: int,
        y: int,
        restart: bool,
        left: wp.array3d[pixel],
        right: wp.array3d[pixel],
        start: int,
        radius_y: int,
        radius_x: int,
        lines: wp.array2d[pixel],
        columns: wp.array2d[sum_type],
        costs: wp.array3d[out],
    ): ...

    @wp.kernel(module="unique", module_options={"enable_backward": False})
    def window_costs(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        start: int,
        radius_y: int,
        radius_x: int,
        # scratch
        lines: wp.array2d[pixel],  # (slabs, 2 rows of lines)
        columns: wp.array2d[sum_type],  # (slabs, (W + 2 radius_x) D)
        # outputs
        costs: wp.array3d[out],  # (H, W, D)
    ):
        for y in range(first, last):
            window_row(
                slab, y, y == first, left, right, start, radius_y, radius_x, lines, columns, costs
            )

    return window_costs
