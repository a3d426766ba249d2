"""Semi-global aggregation of stored costs on the CPU: the sweeps of _steps_cpu.py."""

from functools import lru_cache
from typing import Any

import warp as wp

from ._steps_cpu import BLOCK, OPTIONS, STRIP, WORD, Paths, advance_along, for_number, skew
from ._wavefront_cpu import finish_task, take_task

wp.set_module_options(OPTIONS)

_C_TYPES = {wp.uint8: "unsigned char", wp.uint16: "unsigned short"}

# The next pixels of row i into the block's costs, as uint16. What the block needs soon is called
# from memory on the way: the sums of the pixels, where there are any, and the costs one row ahead.
_FILL = """
    const int height = volume.shape[0], columns = volume.shape[1], depth = volume.shape[2];
    const int padded = costs.shape[1] / BLOCK, y = step > 0 ? i : height - 1 - i;
    for (int j = begin; j < end; ++j) {
        const int x = step > 0 ? j : columns - 1 - j;
        const TYPE* from = volume.data + ((size_t)y * columns + x) * depth;
        if (row >= 0) {
            const unsigned short* soon = sums.data + ((size_t)row * columns + x) * depth;
            for (int d = 0; d < depth; d += 32) __builtin_prefetch(soon + d);
        }
        const TYPE* below = from + (long long)step * columns * depth;
        for (int d = 0; d < depth; d += 64 / sizeof(TYPE)) __builtin_prefetch(below + d);
        unsigned short* to = costs.data + (size_t)slab * costs.shape[1] + (j - begin) * padded;
        #pragma clang loop vectorize(assume_safety)
        for (int d = 0; d < depth; ++d) to[d] = from[d];
    }
"""

_PAD = """
    unsigned short* to = costs.data + (size_t)slab * costs.shape[1];
    const int padded = costs.shape[1] / BLOCK;
    for (int j = 0; j < BLOCK; ++j)
        for (int d = depth; d < padded; ++d) to[j * padded + d] = MOST;
"""


@wp.func_native(for_number(_PAD, WORD))
def pad(slab: int, depth: int, costs: wp.array2d[wp.uint16]): ...


_COLLECT = """
    const int columns = sums.shape[1], depth = sums.shape[2], padded = totals.shape[1] / BLOCK;
    for (int j = begin; j < end; ++j) {
        const int x = step > 0 ? j : columns - 1 - j;
        unsigned short* to = sums.data + ((size_t)row * columns + x) * depth;
        const unsigned short* from =
            totals.data + (size_t)slab * totals.shape[1] + (j - begin) * padded;
        if (add) {
            #pragma clang loop vectorize(assume_safety)
            for (int d = 0; d < depth; ++d) to[d] += from[d];
        } else {
            #pragma clang loop vectorize(assume_safety)
            for (int d = 0; d < depth; ++d) to[d] = from[d];
        }
    }
"""


@wp.func_native(for_number(_COLLECT, WORD))
def collect(
    slab: int,
    row: int,
    begin: int,
    end: int,
    step: int,
    totals: wp.array2d[wp.uint16],
    add: bool,
    sums: wp.array3d[wp.uint16],
):
    """Put the totals of the pixels into the sums, or add them to what is there."""


@lru_cache
def sweep(scalar: Any, paths: Paths) -> wp.Kernel:
    """Return the kernel for costs of one type and some paths."""
    advance, lean = advance_along(paths, WORD), skew(paths)

    @wp.func_native(for_number(_FILL, WORD, TYPE=_C_TYPES[scalar]))
    def fill(
        slab: int,
        i: int,
        begin: int,
        end: int,
        step: int,
        volume: wp.array3d[scalar],
        row: int,
        sums: wp.array3d[wp.uint16],
        costs: wp.array2d[wp.uint16],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def sweep(
        slab: int,
        first: int,
        last: int,
        volume: wp.array3d[scalar],  # (H, W, D)
        guide: wp.array2d[wp.uint8],  # (H, W) or (1, 1)
        p1: int,
        p2: wp.array[wp.uint16],  # (256,)
        step: int,
        add: bool,
        top: int,
        # scratch
        costs: wp.array2d[wp.uint16],  # (slabs, BLOCK padded)
        totals: wp.array2d[wp.uint16],  # (slabs, BLOCK padded)
        slots: wp.array2d[wp.uint16],  # (chains + 1, header + padded)
        strips: int,
        blocks: int,
        tasks: wp.array[int],
        # outputs
        sums: wp.array3d[wp.uint16],  # (h, W, D), of the volume's rows from `top` on
    ):
        height = volume.shape[0]
        columns = volume.shape[1]
        pad(slab, sums.shape[2], costs)
        task = take_task(strips, blocks, tasks)
        while task >= 0:
            strip = task // blocks
            u = (task - strip * blocks) * BLOCK
            for i in range(strip * STRIP, wp.min((strip + 1) * STRIP, height)):
                begin = wp.max(0, u - lean * i)
                end = wp.min(columns, u + BLOCK - lean * i)
                if begin < end:
                    row = wp.where(step > 0, i, height - 1 - i) - top
                    kept = row >= 0 and row < sums.shape[0]
                    fetched = wp.where(add and kept, row, -1)
                    fill(slab, i, begin, end, step, volume, fetched, sums, costs)
                    advance(
                        slab, i, begin, end, step, costs, guide, p1, p2, height, columns, slots,
                        totals,
                    )  # fmt: skip
                    if kept:
                        collect(slab, row, begin, end, step, totals, add, sums)
            task = finish_task(task, strips, blocks, tasks)
            if task < 0:
                task = take_task(strips, blocks, tasks)

    return sweep
