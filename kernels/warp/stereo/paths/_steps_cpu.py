"""Semi-global paths on the CPU: tasks of a few diagonals and rows, shared by all threads.

A sweep over the image from its top left corner takes the paths that come from the left, from above
and from both upper corners; a second one, from the bottom right corner, is the same with the image
turned by half a turn. Number the diagonals of pixels (i, j), counted from the corner, by u = j + i:
what comes before a pixel on these paths stands on diagonal u - 1 (left, above), u - 2 (upper left)
or u (upper right), never on a later one. So a task of STRIP rows of BLOCK diagonals may begin when
those on its left and above it are done, and many may at a time: _wavefront_cpu.py. The paths in
knight's moves are two more such sweeps, with u = j + 2 i.

L of the last pixel of each chain of pixels along a path is kept in a slot, and updated in place, so
that a task finds there what it needs of others. A slot is a header, a cache line with the minimum
of L in its middle, then L over the disparities, padded to full vectors. The costs and sums of a row
of a task, and its slots, stay in the processor's first two caches.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from ._wavefront_cpu import plan_tasks

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

Paths = tuple[tuple[int, int], ...]

BLOCK = 32  # diagonals
STRIP = 16  # rows
PADDED = 32  # the padded number of disparities is a multiple of this

# Where a path goes, in rows and columns, in the sweep from the top left corner.
STRAIGHT = ((0, 1), (1, 0))
DIAGONAL = ((1, 1), (1, -1))
KNIGHT = ((1, 2), (1, -2), (2, 1), (2, -1))


class Number(NamedTuple):
    """What costs and L are kept in: L <= C + P2, and what is larger is taken for the largest."""

    scalar: Any
    c_type: str
    vector: int  # how many are 32 bytes
    header: int  # how many are a cache line
    most: str


BYTE = Number(wp.uint8, "unsigned char", 32, 64, "0xff")
WORD = Number(wp.uint16, "unsigned short", 16, 32, "0xffff")

# L(p, d) = C(p, d) + min(L(q, d), L(q, d - 1) + P1, L(q, d + 1) + P1, m + P2) - m, where q comes
# before p on the path and m is the minimum of L(q): Hirschmueller 2008, equation 13. A chain begins
# with a slot of zeros, which makes L = C. Beside the disparities, and in their padding, stands the
# largest number: it stays, as additions saturate, and is never chosen.
_ADVANCE = """
    typedef NUMBER lanes __attribute__((vector_size(32), aligned(sizeof(NUMBER))));
    typedef unsigned short sums __attribute__((vector_size(2 * VECTOR), aligned(2)));
    const int paths = PATHS, down[] = {DOWN_THE_ROWS}, along[] = {ALONG_THE_ROW};
    const int padded = costs.shape[1] / BLOCK, pitch = slots.shape[1];
    const bool adaptive = guide.shape[0] == height && guide.shape[1] == columns;
    const int row = step > 0 ? i : height - 1 - i;
    const unsigned char* gray = guide.data + (adaptive ? (size_t)row * columns : 0);
    const lanes zero = {}, penalty = zero + (NUMBER)p1;
    for (int j = begin; j < end; ++j) {
        NUMBER* slot[paths];
        size_t chain = 0;
        #pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) {
            const int most = along[q] * (height - 1), last = down[q] * (columns - 1);
            const int here = down[q] * j - along[q] * i + (most > 0 ? most : 0);
            slot[q] = slots.data + (chain + here) * pitch + HEADER;
            chain += last + (most > 0 ? most : -most) + 1;
        }
        NUMBER least[paths], jump[paths];
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
            before[q] = *(const lanes*)(slot[q] - VECTOR);
            now[q] = *(const lanes*)slot[q];
            minimum[q] = zero + (NUMBER)MOST;
        }
        const size_t offset = (size_t)slab * costs.shape[1] + (size_t)(j - begin) * padded;
        const NUMBER* cost = costs.data + offset;
        unsigned short* total = totals.data + offset;
        for (int d = 0; d < padded; d += VECTOR) {
            const lanes c = *(const lanes*)(cost + d);
            sums sum = {};
            #pragma clang loop unroll(full)
            for (int q = 0; q < paths; ++q) {
                const lanes after = *(const lanes*)(slot[q] + d + VECTOR);
                const lanes lower = __builtin_shufflevector(before[q], now[q], LOWER);
                const lanes upper = __builtin_shufflevector(now[q], after, UPPER);
                const lanes beside = __builtin_elementwise_add_sat(
                    __builtin_elementwise_min(lower, upper), penalty);
                const lanes near = __builtin_elementwise_min(now[q], beside);
                const lanes best = __builtin_elementwise_min(near, zero + jump[q]);
                const lanes l = __builtin_elementwise_add_sat(best - least[q], c);
                *(lanes*)(slot[q] + d) = l;
                minimum[q] = __builtin_elementwise_min(minimum[q], l);
                sum += __builtin_convertvector(l, sums);
                before[q] = now[q];
                now[q] = after;
            }
            *(sums*)(total + d) = sum;
        }
        #pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) slot[q][-HEADER / 2] = __builtin_reduce_min(minimum[q]);
    }
"""

_CLEAR = """
    const int pitch = slots.shape[1];
    for (int chain = 0; chain < slots.shape[0]; ++chain) {
        NUMBER* slot = slots.data + (size_t)chain * pitch;
        for (int n = 0; n < pitch; ++n) slot[n] = 0;
        slot[0] = slot[HEADER - 1] = MOST;
    }
"""


def for_number(text: str, number: Number, **names: Any) -> str:
    """Put the constants of this module, those of `number`, and others, into a text of C."""
    names = {
        "BLOCK": BLOCK,
        "NUMBER": number.c_type,
        "VECTOR": number.vector,
        "HEADER": number.header,
        "MOST": number.most,
        **names,
    }
    for name, value in names.items():
        text = text.replace(name, str(value))
    return text


def skew(paths: Paths) -> int:
    """Return by how many columns a block moves to the left from row to row."""
    return max(-along for _, along in paths)


def chains(paths: Paths, height: int, width: int) -> int:
    """Return how many chains of pixels there are along `paths`."""
    return sum(down * (width - 1) + abs(along) * (height - 1) + 1 for down, along in paths)


def sweeps(paths: int) -> list[tuple[Paths, int]]:
    """Return the sweeps of an aggregation: their paths, and from which corner they come."""
    sides = STRAIGHT if paths == 4 else STRAIGHT + DIAGONAL
    groups = (sides, KNIGHT) if paths == 16 else (sides,)
    return [(group, step) for group in groups for step in (1, -1)]


def advance_along(paths: Paths, number: Number) -> Any:
    """Return the function that does `paths` for some pixels of a row of a block."""
    n = number.vector
    text = for_number(
        _ADVANCE,
        number,
        PATHS=len(paths),
        DOWN_THE_ROWS=_list(down for down, _ in paths),
        ALONG_THE_ROW=_list(along for _, along in paths),
        LOWER=_list(range(n - 1, 2 * n - 1)),
        UPPER=_list(range(1, n + 1)),
    )
    scalar = number.scalar

    @wp.func_native(text)
    def advance(
        slab: int,
        i: int,
        begin: int,
        end: int,
        step: int,
        costs: wp.array2d[scalar],
        guide: wp.array2d[wp.uint8],
        p1: int,
        p2: wp.array[wp.uint16],
        height: int,
        columns: int,
        slots: wp.array2d[scalar],
        totals: wp.array2d[wp.uint16],
    ): ...

    return advance


@lru_cache
def prepare(number: Number) -> wp.Kernel:
    """Return the kernel that begins every chain, with a neighbour never chosen between slots."""
    scalar = number.scalar

    @wp.func_native(for_number(_CLEAR, number))
    def clear(slots: wp.array2d[scalar]): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def prepare(
        strips: int,
        blocks: int,
        # outputs
        slots: wp.array2d[scalar],  # (chains + 1, header + padded)
        tasks: wp.array[int],
    ):
        clear(slots)
        plan_tasks(strips, blocks, tasks)

    return prepare


def _list(numbers: Sequence[int] | Any) -> str:
    return ", ".join(map(str, numbers))
