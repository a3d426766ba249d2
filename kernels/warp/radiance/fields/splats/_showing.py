"""What a splat is on the screen, in Warp: its reach, the tiles that it meets, its numbers."""

import warp as wp

from cvkern.kernels.codes import splats as codes

from ._placing import FAINT, Placed
from ._structs import Screen, Sight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE, CULLED = wp.constant(codes.TILE), wp.constant(codes.CULLED)
SLACK = wp.constant(0.01)  # pixels that roundings may take from the reach of a splat


@wp.func
def reach_of(p: Placed) -> wp.vec2:
    """Return how far a splat reaches to the left or right, and up or down; pixels."""
    reach = 2.0 * wp.log(p.opacity / FAINT)
    return wp.vec2(wp.sqrt(reach * p.a) + SLACK, wp.sqrt(reach * p.c) + SLACK)


@wp.func
def box_of(p: Placed, sight: Sight, reach: wp.vec2) -> wp.vec4i:
    """Return the first tile of a splat, column and row, and their columns and rows, or zeros."""
    width = float(sight.width - 1)
    height = float(sight.height - 1)
    box = wp.vec4i(0, 0, 0, 0)
    if (
        p.seen
        and p.column + reach[0] >= 0.0
        and p.column - reach[0] <= width
        and p.row + reach[1] >= 0.0
        and p.row - reach[1] <= height
    ):
        left = int(wp.max(p.column - reach[0], 0.0)) // TILE
        top = int(wp.max(p.row - reach[1], 0.0)) // TILE
        columns = int(wp.min(p.column + reach[0], width)) // TILE + 1 - left
        rows = int(wp.min(p.row + reach[1], height)) // TILE + 1 - top
        box = wp.vec4i(left, top, columns, rows)
    return box


@wp.func
def show(p: Placed, n: int, reach: wp.vec2, distance: float, color: wp.vec3, screen: Screen):
    """Write what a splat is at a pixel; negative colours become 0."""
    determinant = p.a * p.c - p.b * p.b
    screen.shown[n, 0] = p.column
    screen.shown[n, 1] = p.row
    screen.shown[n, 2] = p.c / determinant
    screen.shown[n, 3] = -p.b / determinant
    screen.shown[n, 4] = p.a / determinant
    screen.shown[n, 5] = p.opacity
    for channel in range(3):
        screen.shown[n, 6 + channel] = wp.max(color[channel], 0.0)
    screen.shown[n, 9] = distance
    screen.shown[n, 10] = reach[0]
    screen.shown[n, 11] = reach[1]


@wp.func
def bound(p: Placed, n: int, box: wp.vec4i, screen: Screen):
    """Write the tiles that a splat meets, and its key."""
    for k in range(4):
        screen.boxes[n, k] = box[k]
    screen.keys[n] = wp.where(box[2] > 0, wp.cast(p.depth, int), CULLED)
