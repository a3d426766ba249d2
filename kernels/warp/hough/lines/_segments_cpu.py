"""The line that a point belongs to, on the CPU: one thread per slab of tiles of the image.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's. Each tile lists the lines that pass near its middle. Its points,
64 at a time, are tested against one of these lines after the other, as vector code without
branches.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HALF_TURN = wp.constant(DIRECTIONS // 2)
i32_wide = wp.types.vector(WIDE, wp.int32)


@wp.struct
class Tiles:
    """The points by tiles, which are squares in raster order."""

    side: float  # pixels
    across: int  # tiles in a row of tiles
    order: wp.array[int]  # (N,): points, tile by tile
    starts: wp.array[int]  # (T + 1,): where the points of a tile begin in `order`
    near: wp.array2d[int]  # (slabs, K + 1): scratch for the lines near a tile


@wp.kernel
def claim(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    directions: wp.array[int],  # (K,)
    distance: float,
    tolerance: int,
    tiles: Tiles,
    # outputs
    labels: wp.array[int],  # (N,)
):
    # Rows of a slab are tiles.
    count = lines.shape[1]
    # Half a diagonal, and two pixels because points of the outermost tiles may lie outside them.
    reach = distance + 0.7072 * tiles.side + 2.0
    for tile in range(first, last):
        end = tiles.starts[tile + 1]
        row = tile // tiles.across
        middle_y = (float(row) + 0.5) * tiles.side
        middle_x = (float(tile - row * tiles.across) + 0.5) * tiles.side
        number = int(0)
        if tiles.starts[tile] < end:
            for k in range(count):
                passes = (middle_x * lines[0, k] + middle_y * lines[1, k]) - lines[2, k]
                tiles.near[slab, number] = k
                number += int(wp.abs(passes) <= reach)
        for begin in range(tiles.starts[tile], end, WIDE):
            size = wp.min(WIDE, end - begin)
            y = f32_wide()
            x = f32_wide()
            code = i32_wide()
            past = i32_wide()
            label = i32_wide(count)
            for i in range(size):
                point = tiles.order[begin + i]
                y[i] = points[point, 0]
                x[i] = points[point, 1]
                code[i] = codes[point]
                past[i] = after[point]
            for n in range(number):
                k = tiles.near[slab, n]
                cosine = lines[0, k]
                sine = lines[1, k]
                rho = lines[2, k]
                direction = directions[k]
                for i in range(WIDE):
                    away = wp.abs((x[i] * cosine + y[i] * sine) - rho)
                    turn = (code[i] - direction) & (HALF_TURN - 1)
                    angle = wp.min(turn, HALF_TURN - turn)
                    on = int(away <= distance) & int(angle <= tolerance) & int(k > past[i])
                    label[i] = wp.min(label[i], wp.where(on != 0, k, count))
            for i in range(size):
                labels[tiles.order[begin + i]] = label[i]
