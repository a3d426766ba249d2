"""Semi-global matching of two images on the CPU: costs, sums and winners in two sweeps.

The sweeps are those of _steps_cpu.py, but that the costs of a pixel are made when it comes,
both times: that takes less time than to fetch them from memory. The second sweep adds its sums to
those of the first, and takes the winners, left and right, while they are at hand: in a row, the
blocks come in their order from the right, which is what the right image's winners need.

The right image is unfolded before: of each row, the three bytes of the census and the grey values
are lines of their own, reversed, so that what the disparities of a pixel meet are neighbours.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT
from cvkern.kernels.warp.stereo._winners_cpu import (
    CLEAR_RIGHT,
    INTEGER,
    PICK,
    PICK_RIGHT,
    READ_RIGHT,
    for_kind,
)

from ._aggregation_cpu import collect
from ._steps_cpu import BLOCK, OPTIONS, STRIP, WORD, Number, Paths, advance_along, for_number, skew
from ._wavefront_cpu import finish_task, take_task

# Without fused multiply-add a disparity has the same bits on every device.
wp.set_module_options(OPTIONS)

SPAN = 32  # disparities that costs are made for at a time
LINES = 4

# Costs of pixel (y, x) for SPAN disparities from d on: codes/stereo.py.
_BYTES = f"""
    typedef unsigned char bytes __attribute__((vector_size({SPAN}), aligned(1)));
    const bytes none = {{}};
    const int length = unfolded.shape[1];
"""
_PIXEL = """
    const size_t p = (size_t)y * columns + x;
    const unsigned char* right = unfolded.data + (size_t)y * LINES * length + columns - 1 - x;
    const unsigned long long bits = left_bits.data[p];
    const bytes bits0 = none + (unsigned char)bits, bits1 = none + (unsigned char)(bits >> 8);
    const bytes bits2 = none + (unsigned char)(bits >> 16), gray = none + left.data[p];
"""
_COST = """
    const unsigned char* const r = right + d;
    const bytes distance = __builtin_elementwise_popcount(*(const bytes*)r ^ bits0)
        + __builtin_elementwise_popcount(*(const bytes*)(r + length) ^ bits1)
        + __builtin_elementwise_popcount(*(const bytes*)(r + 2 * length) ^ bits2);
    const bytes other = *(const bytes*)(r + 3 * length);
    const bytes high = __builtin_elementwise_max(gray, other);
    const bytes apart = (high - __builtin_elementwise_min(gray, other)) >> SHIFT;
    const bytes cost = distance * WEIGHT + __builtin_elementwise_min(apart, none + LIMIT);
"""


def _text(text: str, number: Number = WORD) -> str:
    return for_number(
        text,
        number,
        LINES=LINES,
        SPAN=SPAN,
        SHIFT=f"(unsigned char){DIFFERENCE_SHIFT}",
        WEIGHT=f"(unsigned char){CENSUS_WEIGHT}",
        LIMIT=f"(unsigned char){DIFFERENCE_LIMIT}",
    )


@wp.func_native(
    _text("""
    // Place n stands for column W - 1 - first - n, or the nearest one in the image.
    const int columns = gray.shape[1], length = unfolded.shape[1];
    unsigned char* const to = unfolded.data + (size_t)y * LINES * length;
    const unsigned long long* from = bits.data + (size_t)y * columns;
    const unsigned char* values = gray.data + (size_t)y * columns;
    for (int n = 0; n < length; ++n) {
        const int x = columns - 1 - first - n;
        const int inside = x < 0 ? 0 : x < columns ? x : columns - 1;
        to[n] = from[inside];
        to[n + length] = from[inside] >> 8;
        to[n + 2 * length] = from[inside] >> 16;
        to[n + 3 * length] = values[inside];
    }
""")
)
def unfold_row(
    y: int,
    bits: wp.array2d[wp.uint64],
    gray: wp.array2d[wp.uint8],
    first: int,
    unfolded: wp.array2d[wp.uint8],
): ...


@wp.kernel
def unfold(
    slab: int,
    first_row: int,
    last_row: int,
    bits: wp.array2d[wp.uint64],  # (H, W)
    gray: wp.array2d[wp.uint8],  # (H, W)
    first: int,
    # outputs
    unfolded: wp.array2d[wp.uint8],  # (LINES H, W + padded)
):
    for y in range(first_row, last_row):
        unfold_row(y, bits, gray, first, unfolded)


@wp.func_native(
    _text(f"""
    {_BYTES}
    const int columns = costs.shape[1], depth = costs.shape[2];
    for (int x = 0; x < columns; ++x) {{
        {_PIXEL}
        unsigned char* to = costs.data + p * depth;
        for (int d = 0; d < depth; d += SPAN) {{
            {_COST}
            if (d + SPAN <= depth) *(bytes*)(to + d) = cost;
            else
                for (int n = 0; n < depth - d; ++n) to[d + n] = cost[n];
        }}
    }}
""")
)
def cost_row(
    y: int,
    left_bits: wp.array2d[wp.uint64],
    left: wp.array2d[wp.uint8],
    unfolded: wp.array2d[wp.uint8],
    costs: wp.array3d[wp.uint8],
): ...


@wp.kernel
def match_costs(
    slab: int,
    first_row: int,
    last_row: int,
    left_bits: wp.array2d[wp.uint64],  # (H, W)
    left: wp.array2d[wp.uint8],  # (H, W)
    unfolded: wp.array2d[wp.uint8],  # (LINES H, W + padded)
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
):
    for y in range(first_row, last_row):
        cost_row(y, left_bits, left, unfolded, costs)


# The costs of the next pixels of row i of a sweep. Their sums of a row >= 0 are called from memory.
_MAKE_COSTS = f"""
    {_BYTES}
    typedef NUMBER numbers __attribute__((vector_size({SPAN} * sizeof(NUMBER)), aligned(1)));
    const int columns = left.shape[1], padded = costs.shape[1] / BLOCK;
    const int y = step > 0 ? i : left.shape[0] - 1 - i;
    for (int j = begin; j < end; ++j) {{
        const int x = step > 0 ? j : columns - 1 - j;
        {_PIXEL}
        if (row >= 0) {{
            const unsigned short* soon = sums.data + ((size_t)row * columns + x) * padded;
            for (int d = 0; d < padded; d += 32) __builtin_prefetch(soon + d);
        }}
        NUMBER* to = costs.data + (size_t)slab * costs.shape[1] + (j - begin) * padded;
        for (int d = 0; d < count; d += SPAN) {{
            {_COST}
            *(numbers*)(to + d) = __builtin_convertvector(cost, numbers);
        }}
        for (int d = count; d < padded; ++d) to[d] = MOST;
    }}
"""

_DECIDE = f"""
    const int columns = index.shape[1], depth = count, padded = totals.shape[1] / BLOCK;
    const size_t row_length = best.shape[1];
    unsigned short* const best_row = best.data + row_length * y;
    unsigned short* const place_row = place.data + row_length * y;
    for (int j = begin; j < end; ++j) {{
        const int x = columns - 1 - j;
        unsigned short* line = totals.data + (size_t)slab * totals.shape[1] + (j - begin) * padded;
        const unsigned short* before = sums.data + ((size_t)y * columns + x) * padded;
        for (int d = 0; d < padded; d += width)
            *(costs_of*)(line + d) += *(const costs_of*)(before + d);
        for (int d = depth; d < padded; ++d) line[d] = MOST;
        {PICK}
        {PICK_RIGHT}
    }}
"""


@wp.func_native(for_number(for_kind(_DECIDE, INTEGER), WORD))
def decide(
    slab: int,
    y: int,
    begin: int,
    end: int,
    totals: wp.array2d[wp.uint16],
    sums: wp.array3d[wp.uint16],
    first: int,
    count: int,
    subpixel: int,
    uniqueness: int,
    best: wp.array2d[wp.uint16],
    place: wp.array2d[wp.uint16],
    index: wp.array2d[int],
    disparity: wp.array2d[float],
    cost: wp.array2d[float],
    confidence: wp.array2d[float],
):
    """Add the sums of the first sweep; then the winners of these pixels, and of the right image."""


_RIGHT_ROW = """
    const int columns = index.shape[1], padded = (best.shape[1] - columns) / 2;
    unsigned short* const best_row = best.data + (size_t)y * best.shape[1];
    unsigned short* const place_row = place.data + (size_t)y * best.shape[1];
"""


@wp.func_native(for_kind(_RIGHT_ROW + CLEAR_RIGHT, INTEGER))
def clear_right_row(
    y: int, index: wp.array2d[int], best: wp.array2d[wp.uint16], place: wp.array2d[wp.uint16]
): ...


@wp.func_native(for_kind(_RIGHT_ROW + "const int depth = count;" + READ_RIGHT, INTEGER))
def read_right_row(
    y: int,
    count: int,
    best: wp.array2d[wp.uint16],
    place: wp.array2d[wp.uint16],
    index: wp.array2d[int],
): ...


@wp.kernel
def clear_right(
    slab: int,
    first_row: int,
    last_row: int,
    index: wp.array2d[int],  # (h, W)
    # outputs
    best: wp.array2d[wp.uint16],  # (h, W + 2 padded)
    place: wp.array2d[wp.uint16],  # (h, W + 2 padded)
):
    for y in range(first_row, last_row):
        clear_right_row(y, index, best, place)


@wp.kernel
def read_right(
    slab: int,
    first_row: int,
    last_row: int,
    count: int,
    best: wp.array2d[wp.uint16],  # (h, W + 2 padded)
    place: wp.array2d[wp.uint16],  # (h, W + 2 padded)
    # outputs
    index: wp.array2d[int],  # (h, W)
):
    for y in range(first_row, last_row):
        read_right_row(y, count, best, place, index)


@lru_cache
def sweep(paths: Paths, number: Number) -> wp.Kernel:
    """Return the kernel for some paths, with L in numbers that C + P2 fit into."""
    advance, lean = advance_along(paths, number), skew(paths)
    scalar = number.scalar

    @wp.func_native(_text(_MAKE_COSTS, number))
    def make_costs(
        slab: int,
        i: int,
        begin: int,
        end: int,
        step: int,
        left_bits: wp.array2d[wp.uint64],
        left: wp.array2d[wp.uint8],
        unfolded: wp.array2d[wp.uint8],
        count: int,
        row: int,
        sums: wp.array3d[wp.uint16],
        costs: wp.array2d[scalar],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def sweep(
        slab: int,
        first_slab: int,
        last_slab: int,
        left_bits: wp.array2d[wp.uint64],  # (H, W)
        left: wp.array2d[wp.uint8],  # (H, W)
        unfolded: wp.array2d[wp.uint8],  # (LINES H, W + padded)
        first: int,
        count: int,
        p1: int,
        p2: wp.array[wp.uint16],  # (256,)
        step: int,
        add: bool,
        last: bool,
        subpixel: int,
        uniqueness: int,
        top: int,
        # scratch
        costs: wp.array2d[scalar],  # (slabs, BLOCK padded)
        totals: wp.array2d[wp.uint16],  # (slabs, BLOCK padded)
        slots: wp.array2d[scalar],  # (chains + 1, header + padded)
        strips: int,
        blocks: int,
        tasks: wp.array[int],
        sums: wp.array3d[wp.uint16],  # (h, W, padded)
        best: wp.array2d[wp.uint16],  # (h, W + 2 padded)
        place: wp.array2d[wp.uint16],  # (h, W + 2 padded)
        # outputs, of the rows from `top` on
        index: wp.array2d[int],  # (h, W), as the others
        disparity: wp.array2d[float],
        cost: wp.array2d[float],
        confidence: wp.array2d[float],
    ):
        height = left.shape[0]
        columns = left.shape[1]
        task = take_task(strips, blocks, tasks)
        while task >= 0:
            strip = task // blocks
            u = (task - strip * blocks) * BLOCK
            for i in range(strip * STRIP, wp.min((strip + 1) * STRIP, height)):
                begin = wp.max(0, u - lean * i)
                end = wp.min(columns, u + BLOCK - lean * i)
                if begin < end:
                    row = wp.where(step > 0, i, height - 1 - i) - top
                    kept = row >= 0 and row < index.shape[0]
                    fetched = wp.where(kept and add, row, -1)
                    make_costs(
                        slab, i, begin, end, step, left_bits, left, unfolded, count, fetched,
                        sums, costs,
                    )  # fmt: skip
                    advance(
                        slab, i, begin, end, step, costs, left, p1, p2, height, columns, slots,
                        totals,
                    )  # fmt: skip
                    if kept:
                        if last:
                            decide(
                                slab, row, begin, end, totals, sums, first, count, subpixel,
                                uniqueness, best, place, index, disparity, cost, confidence,
                            )  # fmt: skip
                        else:
                            collect(slab, row, begin, end, step, totals, add, sums)
            task = finish_task(task, strips, blocks, tasks)
            if task < 0:
                task = take_task(strips, blocks, tasks)

    return sweep
