"""Semi-global aggregation of matching costs, in Taichi.

Let q be the pixel before p on a path, C the costs, and m the smallest L(q). Then the cost of the
cheapest path to p at disparity d is

    L(p, d) = C(p, d) + min(L(q, d), L(q, d - 1) + P1, L(q, d + 1) + P1, m + P2) - m

and the result is the sum over the paths from all directions (H. Hirschmueller, IEEE PAMI 30(2),
2008, equations 13 and 14). One thread walks one path; directions follow one after the other.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import Penalties
from cvkern.kernels.taichi._launch import primitive, scratch

any_3 = ti.types.ndarray(ndim=3)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u16_1 = ti.types.ndarray(dtype=ti.u16, ndim=1)
u16_3 = ti.types.ndarray(dtype=ti.u16, ndim=3)


@ti.func
def _start(c: ti.i32, dy: ti.i32, dx: ti.i32, height: ti.i32, width: ti.i32) -> ti.math.ivec2:
    """Return the pixel at which path number `c` of direction (dy, dx) enters the image."""
    rows = ti.min(ti.abs(dy), height)  # paths begin in this many rows of one edge ...
    columns = ti.min(ti.abs(dx), width)  # ... and in this many columns of another
    y = 0
    x = 0
    if c < rows * width:
        y = c // width
        x = c % width
    else:
        y = rows + (c - rows * width) // columns
        x = (c - rows * width) % columns
    if dy < 0:
        y = height - 1 - y
    if dx < 0:
        x = width - 1 - x
    return ti.Vector([y, x])


@ti.kernel
def _walk(
    costs: any_3,  # (H, W, D)
    guide: u8_2,  # (H, W), or (1, 1) where there is none
    p1: ti.i32,
    p2_of: u16_1,  # (256,) by how much the guide changes along the path
    count: ti.i32,  # how many paths there are
    dy: ti.i32,
    dx: ti.i32,
    first: ti.i32,  # whether nothing has been summed yet
    lines: i32_3,  # (2, count, D) scratch
    top: ti.i32,
    # outputs
    sums: u16_3,  # (h, W, D), rows of the image from `top` on
):
    height = costs.shape[0]
    width = costs.shape[1]
    depth = costs.shape[2]
    for c in range(count):
        position = _start(c, dy, dx, height, width)
        y = position[0]
        x = position[1]
        lowest = 0  # the minimum over d at the pixel before
        new = 0  # number, 0 or 1, of this pixel's line
        begun = 0
        while 0 <= y < height and 0 <= x < width:
            p2 = ti.cast(p2_of[0], ti.i32)
            if begun == 1 and guide.shape[0] == height and guide.shape[1] == width:
                step = ti.cast(guide[y, x], ti.i32) - ti.cast(guide[y - dy, x - dx], ti.i32)
                p2 = ti.cast(p2_of[ti.abs(step)], ti.i32)
            least = 1 << 30
            for d in range(depth):
                value = ti.cast(costs[y, x, d], ti.i32)
                if begun == 1:
                    best = ti.min(lines[1 - new, c, d], lowest + p2)
                    if d > 0:
                        best = ti.min(best, lines[1 - new, c, d - 1] + p1)
                    if d < depth - 1:
                        best = ti.min(best, lines[1 - new, c, d + 1] + p1)
                    value += best - lowest
                lines[new, c, d] = value
                least = ti.min(least, value)
                if 0 <= y - top < sums.shape[0]:
                    total = value
                    if first == 0:
                        total += ti.cast(sums[y - top, x, d], ti.i32)
                    sums[y - top, x, d] = ti.cast(total, ti.u16)
            lowest = least
            new = 1 - new
            begun = 1
            y += dy
            x += dx


# The directions of the first 4, 8 and 16 paths.
_STEPS = (
    *((0, 1), (0, -1), (1, 0), (-1, 0)),
    *((1, 1), (1, -1), (-1, 1), (-1, -1)),
    *((1, 2), (1, -2), (-1, 2), (-1, -2)),
    *((2, 1), (2, -1), (-2, 1), (-2, -1)),
)


def _aggregate(
    costs: np.ndarray,
    guide: np.ndarray,
    penalties: Penalties,
    paths: int,
    top: int,
    sums: np.ndarray,
) -> None:
    height, width, depth = costs.shape
    for i, (dy, dx) in enumerate(_STEPS[:paths]):
        rows, columns = min(abs(dy), height), min(abs(dx), width)
        count = rows * width + columns * (height - rows)
        lines = scratch((2, count, depth), np.int32)
        near, far, _ = penalties
        _walk(costs, guide, near, far, count, dy, dx, int(i == 0), lines, top, sums)


@primitive
def aggregate(
    costs: np.ndarray,
    guide: np.ndarray,
    penalties: Penalties,
    paths: int,
    top: int,
    sums: np.ndarray,
) -> None:
    """Sum the costs of the cheapest paths to each pixel; one thread per path.

    A guide of shape (1, 1) means that there is none.
    """
    _aggregate(costs, guide, penalties, paths, top, sums)


def aggregation_bytes(device: str, height: int, width: int, depth: int, paths: int, p2: int) -> int:
    """Return the bytes to allow for the work, in addition to the costs and the sums.

    The result is that of the Warp set, so that both cut an image into the same strips of rows.
    """
    padded = -(-depth // 32) * 32
    if device == "cpu":
        return 2 * 6 * (height + width) * (padded + 32)
    return height * width * padded * (min(paths, 8) * (1 if p2 < 256 else 2) + 2)
