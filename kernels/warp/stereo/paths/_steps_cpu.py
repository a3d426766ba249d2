"""Semi-global paths on the CPU: tasks of a few diagonals and rows, shared by all threads.

A sweep over the image from its top left corner computes the paths that come from the left, from
above and from both upper corners. A second sweep, from the bottom right corner, is the same with
the image rotated by half a turn. Count pixels (i, j) from the corner, and number the diagonals by
u = j + i. The preceding pixel on these paths is on diagonal u - 1 (left, above), u - 2 (upper left)
or u (upper right), never on a later one. So a task of STRIP rows of BLOCK diagonals may begin when
the tasks to the left and above are done, and many tasks can run at a time. The paths in knight's
moves are two more such sweeps, with u = j + 2 i.

_steps_cpu.h has the tasks, and the equation of a step. The costs and sums of a row of a task, and
its slots, stay in the first two levels of cache. The code is native, because a step is saturating
arithmetic on vectors of 32 or 64 bytes, and because threads take tasks by atomics.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.codes.stereo import Penalties
from cvkern.kernels.warp._launch import launch, scratch, view
from cvkern.kernels.warp.stereo._winners_cpu import padded

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

Paths = tuple[tuple[int, int], ...]

BLOCK = 32  # diagonals of a task
STRIP = 16  # rows of a task
STATE = 16  # integers that the tasks share, before those of each task

# The steps of paths, in rows and columns, in the sweep from the top left corner.
STRAIGHT = ((0, 1), (1, 0))
DIAGONAL = ((1, 1), (1, -1))
KNIGHT = ((1, 2), (1, -2), (2, 1), (2, -1))


class Number(NamedTuple):
    """The type of costs and of L <= C + P2; larger sums saturate at its largest number."""

    scalar: Any
    vector: int
    """Numbers in a vector, a divisor of the padded number of disparities."""
    header: int
    """Numbers in a cache line."""
    largest: str
    total: Any = wp.uint16
    """The type of sums over paths: of L, or, if it is a byte, of L - C <= P2."""


WORD = Number(wp.uint16, 32, 32, "0xffff")


def byte(depth: int, total: Any) -> Number:
    """Return the numbers that are bytes, for a number of disparities."""
    return Number(wp.uint8, 64 if padded(depth) % 64 == 0 else 32, 64, "0xff", total)


@wp.struct
class Course:
    """The parameters of a sweep: its penalties, its corner and its tasks."""

    near: int
    far: wp.array[wp.uint16]  # (256,)
    step: int  # 1 from the first corner of the image, -1 from the last
    add: bool  # whether there are sums of other sweeps
    last: bool  # whether it is the last sweep
    top: int  # row of the image that is the first of the sums
    strips: int
    blocks: int
    tasks: wp.array[int]


@lru_cache
def work_of(number: Number) -> Any:
    """Return the struct of the threads' working memory."""
    scalar, total = number.scalar, number.total

    @wp.struct
    class Work:
        costs: wp.array2d[scalar]  # (slabs, BLOCK padded)
        totals: wp.array2d[total]  # (slabs, BLOCK padded)
        slots: wp.array2d[scalar]  # (chains + 1, header + padded)

    return Work


def constants(paths: Paths, number: Number) -> dict[str, Any]:
    """Return the constants of _steps_cpu.h."""
    words = number.vector * wp.types.type_size_in_bytes(number.scalar) // 8
    return {
        "NUMBER": number.scalar,
        "VECTOR": number.vector,
        "LAST_WORDS": _list(range(words - 1, 2 * words - 1)),
        "NEXT_WORDS": _list(range(1, words + 1)),
        "HEADER": number.header,
        "LARGEST": number.largest,
        "TOTAL": number.total,
        "CHANGES": int(number.total is wp.uint8),
        "BLOCK": BLOCK,
        "STRIP": STRIP,
        "STATE": STATE,
        "LEAN": _lean(paths),
        "PATHS": len(paths),
        "DOWN_THE_ROWS": _list(down for down, _ in paths),
        "ALONG_THE_ROW": _list(along for _, along in paths),
    }


def _lean(paths: Paths) -> int:
    """Return the number of columns by which a block moves to the left per row."""
    return max(-along for _, along in paths)


def sweeps(paths: int) -> list[tuple[Paths, int]]:
    """Return the sweeps of an aggregation: their paths, and the corner where each begins."""
    sides = STRAIGHT if paths == 4 else STRAIGHT + DIAGONAL
    groups = (sides, KNIGHT) if paths == 16 else (sides,)
    return [(group, step) for group in groups for step in (1, -1)]


@wp.kernel
def _prepare(
    strips: int,
    blocks: int,
    lean: int,
    first: wp.uint64,
    middle: wp.uint64,
    header: int,
    # outputs
    slots: wp.array2d[wp.uint64],  # (chains + 1, words of a slot)
    tasks: wp.array[int],  # (STATE + 2 strips blocks,)
):
    # Every chain begins with zeros; on both sides of them is a number that is never chosen.
    for chain in range(slots.shape[0]):
        for n in range(slots.shape[1]):
            slots[chain, n] = wp.uint64(0)
        slots[chain, 0] = first
        slots[chain, header - 1] = middle
    # The lock, the counts and the tasks of _steps_cpu.h: only the task in the corner may begin.
    count = strips * blocks
    tasks[0] = 0
    tasks[1] = count
    tasks[2] = 1
    tasks[STATE] = 0
    for r in range(strips):
        moved = lean * STRIP * r // BLOCK - lean * STRIP * (r - 1) // BLOCK
        for c in range(blocks):
            waits = wp.min(c, 1)
            if r > 0 and c + moved < blocks:
                waits += 1
            tasks[STATE + count + r * blocks + c] = waits


def begin(
    paths: Paths, number: Number, shape: tuple[int, int, int], device: wp.Device
) -> tuple[wp.array, tuple[int, int, wp.array]]:
    """Return the initial state of a sweep over (H, W, D): its slots, grid of tasks, and tasks."""
    height, width, depth = shape
    strips = -(-height // STRIP)
    lean = _lean(paths)
    # The diagonals of a strip, and those before its first one in the same block.
    blocks = -(-(BLOCK - 1 + width + lean * (STRIP - 1)) // BLOCK)
    chains = sum(down * (width - 1) + abs(along) * (height - 1) + 1 for down, along in paths)
    # After the last slot there is one more header, which ends the last slot's disparities.
    pitch = number.header + padded(depth)
    slots = scratch("semi_global.slots", (chains + 1, pitch), number.scalar, device)
    tasks = scratch("semi_global.tasks", (STATE + 2 * strips * blocks,), wp.int32, device)
    size = wp.types.type_size_in_bytes(number.scalar)
    words = view(slots, wp.uint64, (chains + 1, pitch * size // 8))
    largest = int(number.largest, 16)
    ends = wp.uint64(largest), wp.uint64(largest << 64 - 8 * size)
    launch(_prepare, 1, [strips, blocks, lean, *ends, number.header * size // 8], [words, tasks])
    return slots, (strips, blocks, tasks)


def lines(count: int, depth: int, number: Number, device: wp.Device) -> tuple[wp.array, wp.array]:
    """Return memory for the costs and the sums of the current pixels of each of `count` slabs."""
    shape = (count, BLOCK * padded(depth))
    return (
        scratch("semi_global.costs", shape, number.scalar, device),
        scratch("semi_global.totals", shape, number.total, device),
    )


def course_of(
    penalties: Penalties, step: int, place: tuple[bool, bool], top: int, tasks: Any
) -> Course:
    """Return the struct of a sweep; `place` tells whether other sweeps precede or follow it."""
    course = Course()
    course.near, course.far, course.step, course.top = penalties.near, penalties.far, step, top
    course.add, course.last = place[0], not place[1]
    course.strips, course.blocks, course.tasks = tasks
    return course


def _list(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))
