"""Matching costs summed over windows on the CPU, in C.

One thread goes through a slab of rows. The sums down the columns of the windows are kept for one
row of the image, a run of disparities in a vector; from one row to the next, one row of costs comes
and one goes. Summed along the row in the same way they give the windows. Sums of integers are the
same in every order; those of floats are made anew for every pixel, each column from its top down,
then the columns from left to right. _windows_cuda.py has the same for CUDA.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp._launch import scratch

C_TYPES = {
    wp.uint8: "unsigned char",
    wp.uint16: "unsigned short",
    wp.int32: "int",
    wp.float32: "float",
    wp.float64: "double",
    wp.uint64: "unsigned char",  # an octet at a time
}
# Disparities at once, by the type of sums.
LANES_OF = {wp.uint16: 64, wp.int32: 32, wp.float32: 32, wp.float64: 16}

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
    Cost.CENSUS: """
                bytes += __builtin_elementwise_popcount(a ^ b);
                if (c % 16 < 15 && c < channels - 1) continue;  // they hold 16 times 8 bits
                total += __builtin_convertvector(bytes, sums);
                bytes = (pixels){};""",
    Cost.ZNCC: """
                total += __builtin_convertvector(a, sums) * __builtin_convertvector(b, sums);""",
}

# Lines of one row of both images, continued on both sides by their outermost pixels: of each
# channel the values, then, where a cost asks for them, the lows and the highs. Lines of the right
# image are reversed, so that the partners of a pixel stand in the order of their disparities.
_LINES = """
    #pragma clang fp contract(off)
    typedef PIXEL pixels
        __attribute__((vector_size(LANES * sizeof(PIXEL)), aligned(sizeof(PIXEL)), may_alias));
    typedef SUM sums
        __attribute__((vector_size(LANES * sizeof(SUM)), aligned(sizeof(SUM)), may_alias));
    const int height = left.shape[0], width = left.shape[1];
    // The octets of a census that are used are channels of their own.
    const int stride = left.shape[2], channels = stride * octets;
    const int range = (count + LANES - 1) / LANES * LANES;
    const int wide = width + 2 * radius_x;
    // One place more on each side, for the neighbours of the outermost.
    const int left_pitch = wide + 2, right_pitch = wide + range + 2;
    const size_t right_lines = (size_t)PLANES * channels * left_pitch;
    const size_t row_lines = right_lines + (size_t)PLANES * channels * right_pitch;
    PIXEL* const slab_lines = lines.data + (size_t)slab * lines.shape[1];
    const auto put = [&](PIXEL* to, int length, const ELEMENT* from, int octet, int x, int step) {
        // Place i has column x + step i: those of places `first` to `last` are in the image.
        int first = step > 0 ? -x : x - width + 1, last = step > 0 ? width - x : x + 1;
        first = first < 0 ? 0 : first < length ? first : length;
        last = last < first ? first : last < length ? last : length;
        const PIXEL least = from[0] OCTET, most = from[(size_t)(width - 1) * stride] OCTET;
        for (int i = 0; i < first; ++i) to[i] = step > 0 ? least : most;
        for (int i = last; i < length; ++i) to[i] = step > 0 ? most : least;
        if (stride > 1) {
            for (int i = first; i < last; ++i)
                to[i] = from[(size_t)(x + step * i) * stride] OCTET;
        } else if (step > 0) {
            #pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = from[x + i] OCTET;
        } else {
            #pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = from[x - i] OCTET;
        }
        if (PLANES == 1) return;
        PIXEL* const low = to + (size_t)channels * length;
        PIXEL* const high = low + (size_t)channels * length;
        low[0] = low[length - 1] = high[0] = high[length - 1] = 0;
        #pragma clang loop vectorize(assume_safety)
        for (int i = 1; i < length - 1; ++i) {
            const PIXEL here = to[i], one = (to[i - 1] + here) / 2, two = (here + to[i + 1]) / 2;
            const PIXEL least = one < two ? one : two, most = one < two ? two : one;
            low[i] = here < least ? here : least;
            high[i] = here < most ? most : here;
        }
    };
    const auto put_row = [&](int row, int place) {
        row = row < 0 ? 0 : row < height ? row : height - 1;
        PIXEL* const to = slab_lines + place * row_lines;
        for (int c = 0; c < channels; ++c) {
            const size_t from = (size_t)row * width * stride + c / octets;
            put(to + (size_t)c * left_pitch, left_pitch, (const ELEMENT*)left.data + from,
                c % octets, -radius_x - 1, 1);
            put(to + right_lines + (size_t)c * right_pitch, right_pitch,
                (const ELEMENT*)right.data + from, c % octets, width + radius_x - start, -1);
        }
    };
"""

_SUMS = """
    // The costs of place x of the lines, for the disparities from `chunk` on.
    const auto cost_of = [&](int place, int x, int chunk) {
        const PIXEL* lefts = slab_lines + place * row_lines + 1 + x;
        const PIXEL* rights = slab_lines + place * row_lines + right_lines + wide - x + chunk;
        sums total = {};
        pixels bytes = {};
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
            OUT* const to = costs.data + ((size_t)y * width + x - 2 * radius_x) * count + chunk;
            if (chunk + LANES <= count) *(outs*)to = value;
            else for (int k = 0; chunk + k < count; ++k) to[k] = value[k];
"""


def sums_dtype(pixel: Any, out: Any) -> Any:
    """Return the type of sums that hold what `out` holds."""
    if pixel is wp.float32:
        return wp.float32
    return wp.int32 if out is wp.float32 else wp.uint16


def padded(count: int, sums: Any) -> int:
    """Return `count` disparities in whole vectors."""
    return -(-count // LANES_OF[sums]) * LANES_OF[sums]


def slab_scratch(
    left: wp.array, slabs: int, count: int, cost: int, octets: int, radius_x: int, sums: Any
) -> tuple[wp.array, wp.array]:
    """Return the lines of two rows, and the sums down the columns, of each slab."""
    reach = padded(count, sums)
    wide = left.shape[1] + 2 * radius_x
    planes = left.shape[2] * octets * (3 if cost == Cost.BIRCHFIELD_TOMASI else 1)
    pixel = wp.float32 if left.dtype is wp.float32 else wp.uint8
    lines = (slabs, 2 * planes * (2 * wide + reach + 4))
    return (
        scratch("window.lines", lines, pixel, left.device),
        scratch("window.columns", (slabs, wide * reach), sums, left.device),
    )


def row_text(
    cost: int, pixel: Any, sums: Any, emit: str, *, before: str = "", after: str = "", out: Any = 0
) -> str:
    """Return the C of a row: what is done with each sum, and before and after them."""
    text = _LINES + before + _SUMS.replace("EMIT", emit) + after
    text = text.replace("COST", _COSTS[Cost(cost)])
    for name, value in {
        "MIN": "__builtin_elementwise_min",
        "MAX": "__builtin_elementwise_max",
        "PLANES": "3" if cost == Cost.BIRCHFIELD_TOMASI else "1",
        "FLOATS": "true" if pixel is wp.float32 else "false",
        "LANES": str(LANES_OF[sums]),
        "OCTET": ">> 8 * octet" if pixel is wp.uint64 else "",
        "ELEMENT": "unsigned long long" if pixel is wp.uint64 else "PIXEL",
        "PIXEL": C_TYPES[pixel],
        "SUM": C_TYPES[sums],
        "OUT": C_TYPES.get(out, ""),
    }.items():
        text = text.replace(name, value)
    return text


@cache
def window_costs(cost: int, pixel: Any, out: Any) -> wp.Kernel:
    """Return the kernel of a cost, for images and costs of these types."""
    sums = sums_dtype(pixel, out)

    @wp.func_native(row_text(cost, pixel, sums, _STORE, out=out))
    def window_row(
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
        lines: wp.array2d[wp.float32 if pixel is wp.float32 else wp.uint8],
        columns: wp.array2d[sums],
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
        octets: int,
        radius_y: int,
        radius_x: int,
        # scratch
        lines: wp.array2d[wp.float32 if pixel is wp.float32 else wp.uint8],  # (slabs, 2 rows)
        columns: wp.array2d[sums],  # (slabs, (W + 2 radius_x) padded(D))
        # outputs
        costs: wp.array3d[out],  # (H, W, D)
    ):
        for y in range(first, last):
            window_row(
                slab, y, y == first, left, right, start, costs.shape[2], octets,
                radius_y, radius_x, lines, columns, costs,
            )  # fmt: skip

    return window_costs
