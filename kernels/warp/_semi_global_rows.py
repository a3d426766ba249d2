"""Semi-global aggregation on the CPU: tasks of a few diagonals and rows, shared by all threads.

A sweep over the image from its top left corner takes the paths that come from the left, from above
and from both upper corners; a second one, from the bottom right corner, is the same with the image
turned by half a turn. Number the diagonals of pixels (i, j), counted from the corner, by u = j + i:
what comes before a pixel on these paths stands on diagonal u - 1 (left, above), u - 2 (upper left)
or u (upper right), never on a later one. So a task of STRIP rows of BLOCK diagonals may begin when
those on its left and above it are done, and many may at a time: _wavefront.py. The paths in
knight's moves are two more such sweeps, with u = j + 2 i.

L of the last pixel of each chain of pixels along a path is kept in a slot, and updated in place, so
that a task finds there what it needs of others. A slot is a header of HEADER numbers with the
minimum of L among them, then L over the disparities, padded to full vectors. The costs and sums of
a row of a task, and its slots, stay in the processor's first two caches.

All numbers are uint16. The API lets through what has 4 (C + P2) < 2^16 at least, so that L < PAD.
Padding costs PAD, and its L stays below PAD + P2; nothing here exceeds PAD + P1 + P2 < 2^16.
"""

from collections.abc import Sequence
from typing import Any

import warp as wp

from ._wavefront import finish_task, plan_tasks, take_task

wp.set_module_options({"enable_backward": False})

BLOCK = 32  # diagonals
STRIP = 16  # rows
HEADER = 32  # a cache line, half of it below L(-1)
PAD = 0x4000
PADDED = 32  # the padded number of disparities is a multiple of this

# Where a path goes, in rows and columns, in the sweep from the top left corner.
STRAIGHT = ((0, 1), (1, 0))
DIAGONAL = ((1, 1), (1, -1))
KNIGHT = ((1, 2), (1, -2), (2, 1), (2, -1))

_LANES = """
    typedef unsigned short u16;
    typedef u16 lanes __attribute__((vector_size(32), aligned(2)));
    const int WIDTH = sizeof(lanes) / sizeof(u16);
    #define UP(a, b) __builtin_shufflevector(a, b, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, \\
        26, 27, 28, 29, 30)
    #define DOWN(a, b) __builtin_shufflevector(a, b, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, \\
        14, 15, 16)
"""

# L(p, d) = C(p, d) + min(L(q, d), L(q, d - 1) + P1, L(q, d + 1) + P1, m + P2) - m, where q comes
# before p on the path and m is the minimum of L(q): Hirschmueller 2008, equation 13. A chain begins
# with a slot of zeros, which makes L = C.
_ADVANCE = (
    _LANES
    + """
    const int paths = PATHS, down[] = {DOWN_THE_ROWS}, along[] = {ALONG_THE_ROW};
    const int padded = costs.shape[1] / BLOCK, pitch = HEADER + padded;
    const bool adaptive = guide.shape[0] == height && guide.shape[1] == columns;
    const int row = step > 0 ? i : height - 1 - i;
    const unsigned char* gray = guide.data + (adaptive ? (size_t)row * columns : 0);
    const lanes zero = {};
    for (int j = begin; j < end; ++j) {
        u16* slot[paths];
        size_t chain = 0;
        #pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) {
            const int most = along[q] * (height - 1), last = down[q] * (columns - 1);
            const int here = down[q] * j - along[q] * i + (most > 0 ? most : 0);
            slot[q] = slots.data + (chain + here) * pitch + HEADER;
            chain += last + (most > 0 ? most : -most) + 1;
        }
        u16 least[paths], jump[paths];
        lanes before[paths], now[paths], minimum[paths];
        #pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) {
            int difference = 0;
            if (adaptive && i >= down[q] && j >= along[q] && j - along[q] < columns) {
                const unsigned char* p = gray + (step > 0 ? j : columns - 1 - j);
                difference = *p - p[-step * (down[q] * columns + along[q])];
            }
            least[q] = slot[q][-HEADER / 2];
            jump[q] = least[q] + p2.data[difference < 0 ? -difference : difference];
            before[q] = *(const lanes*)(slot[q] - WIDTH);
            now[q] = *(const lanes*)slot[q];
            minimum[q] = zero + (u16)0xffff;
        }
        const size_t offset = (size_t)slab * costs.shape[1] + (size_t)(j - begin) * padded;
        const u16* cost = costs.data + offset;
        u16* total = totals.data + offset;
        for (int d = 0; d < padded; d += WIDTH) {
            const lanes c = *(const lanes*)(cost + d);
            lanes sum = zero;
            #pragma clang loop unroll(full)
            for (int q = 0; q < paths; ++q) {
                const lanes after = *(const lanes*)(slot[q] + d + WIDTH);
                const lanes beside =
                    __builtin_elementwise_min(UP(before[q], now[q]), DOWN(now[q], after));
                const lanes near = __builtin_elementwise_min(now[q], beside + (u16)p1);
                const lanes l = __builtin_elementwise_min(near, zero + jump[q]) + (c - least[q]);
                *(lanes*)(slot[q] + d) = l;
                minimum[q] = __builtin_elementwise_min(minimum[q], l);
                sum += l;
                before[q] = now[q];
                now[q] = after;
            }
            *(lanes*)(total + d) = sum;
        }
        #pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) slot[q][-HEADER / 2] = __builtin_reduce_min(minimum[q]);
    }
"""
)

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


def in_blocks(text: str, **names: Any) -> str:
    """Put the constants of this module, and others, into a text of C."""
    names = {"BLOCK": BLOCK, "HEADER": HEADER, "PAD": PAD, **names}
    for name, value in names.items():
        text = text.replace(name, str(value))
    return text


def skew(paths: Sequence[tuple[int, int]]) -> int:
    """Return by how many columns a block moves to the left from row to row."""
    return max(-along for _, along in paths)


def advance_along(paths: Sequence[tuple[int, int]]) -> Any:
    """Return the function that does `paths` for some pixels of a row of a block."""
    text = in_blocks(
        _ADVANCE,
        PATHS=len(paths),
        DOWN_THE_ROWS=", ".join(str(down) for down, _ in paths),
        ALONG_THE_ROW=", ".join(str(along) for _, along in paths),
    )

    @wp.func_native(text)
    def advance(
        slab: int,
        i: int,
        begin: int,
        end: int,
        step: int,
        costs: wp.array2d[wp.uint16],
        guide: wp.array2d[wp.uint8],
        p1: int,
        p2: wp.array[wp.uint16],
        height: int,
        columns: int,
        slots: wp.array[wp.uint16],
        totals: wp.array2d[wp.uint16],
    ): ...

    return advance


@wp.func_native(
    in_blocks("""
    const int pitch = HEADER + padded;
    const size_t size = slots.shape[0];
    for (size_t n = 0; n < size; ++n) slots.data[n] = 0;
    for (size_t n = 0; n < size; n += pitch) slots.data[n] = slots.data[n + HEADER - 1] = PAD;
""")
)
def clear(padded: int, slots: wp.array[wp.uint16]):
    """Begin every chain; between slots, a neighbour that is never chosen."""


@wp.func_native(
    in_blocks("""
    unsigned short* to = costs.data + (size_t)slab * costs.shape[1];
    const int padded = costs.shape[1] / BLOCK;
    for (int j = 0; j < BLOCK; ++j)
        for (int d = depth; d < padded; ++d) to[j * padded + d] = PAD;
""")
)
def pad(slab: int, depth: int, costs: wp.array2d[wp.uint16]): ...


@wp.func_native(
    in_blocks("""
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
""")
)
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


@wp.kernel
def prepare(
    padded: int,
    strips: int,
    blocks: int,
    # outputs
    slots: wp.array[wp.uint16],
    tasks: wp.array[int],
):
    clear(padded, slots)
    plan_tasks(strips, blocks, tasks)


def _sweep(scalar: Any, c_type: str, paths: Sequence[tuple[int, int]]) -> wp.Kernel:
    """Return the kernel for costs of one type and some paths."""
    advance, lean = advance_along(paths), skew(paths)

    @wp.func_native(in_blocks(_FILL, TYPE=c_type))
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

    @wp.kernel
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
        slots: wp.array[wp.uint16],
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
                        slab,
                        i,
                        begin,
                        end,
                        step,
                        costs,
                        guide,
                        p1,
                        p2,
                        height,
                        columns,
                        slots,
                        totals,
                    )
                    if kept:
                        collect(slab, row, begin, end, step, totals, add, sums)
            task = finish_task(task, strips, blocks, tasks)
            if task < 0:
                task = take_task(strips, blocks, tasks)

    return sweep


sweeps = {
    (scalar, paths): _sweep(scalar, c_type, paths)
    for scalar, c_type in ((wp.uint8, "unsigned char"), (wp.uint16, "unsigned short"))
    for paths in (STRAIGHT, STRAIGHT + DIAGONAL, KNIGHT)
}
