"""Edges on the CPU: one thread per slab of rows, row by row.

Sobel's kernels are [1 2 1] across and [-1 0 1] along. Thinning keeps a pixel if it is a maximum
along the gradient; its state tells which of the thresholds it exceeds (Canny, "A computational
approach to edge detection", TPAMI 1986). Derivatives of bytes, thinning, which chooses among
neighbours, and flood fill, which needs a stack, are native.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.edges import SECTOR_HIGH, SECTOR_LOW, SECTOR_ONE, Edge, Norm, Thinning
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# The scratch of a slab consists of lines of W + 2 floats: pixel x is at x + 1, between margins of
# one. A slab holds the rows y - 1, y and y + 1 of derivatives and measures, row r in line r mod 3.
SUMS = wp.constant(0)
DIFFERENCES = wp.constant(1)
DOWN = wp.constant(2)
ALONG = wp.constant(5)
MEASURES = wp.constant(8)
STRIP = 512  # columns that are processed together, so that their lines stay in the fastest cache
LINES = 11  # lines of a slab that differentiates
MEASURE_LINES = 3  # lines of a slab whose derivatives are inputs
u8_wide = wp.types.vector(WIDE, wp.uint8)


def _thin_row(interpolated: bool) -> Any:
    """Return the function that thins a row by one of the rules."""

    @_native.func_native(
        "_masks_cpu.h",
        INTERPOLATED=int(interpolated),
        SECTOR_ONE=SECTOR_ONE,
        SECTOR_LOW=SECTOR_LOW,
        SECTOR_HIGH=SECTOR_HIGH,
    )
    def thin_row(
        y: int,
        dy: wp.array2d[f32_wide],
        dx: wp.array2d[f32_wide],
        margin: int,
        lines: wp.array2d[f32_wide],
        rows: wp.vec3i,
        columns: wp.vec2i,
        norm: int,
        limits: wp.vec2,
        framed: bool,
        states: wp.array2d[wp.uint8],
    ): ...

    return thin_row


thin_in_sectors = _thin_row(False)
thin_between = _thin_row(True)


@_native.func_native(
    "_masks_cpu.h", SUMS=SUMS, DIFFERENCES=DIFFERENCES, DOWN=DOWN, ALONG=ALONG, MEASURES=MEASURES
)
def sobel_row(
    y: int,
    src: wp.array2d[u8_wide],
    rows: wp.vec2i,
    ends: wp.vec2i,
    columns: wp.vec3i,
    cval: float,
    norm: int,
    # outputs
    lines: wp.array2d[float],
    base: int,
): ...


@_native.func_native("_masks_cpu.h")
def flood(
    first: int,
    last: int,
    least: int,
    start: int,
    stop: int,
    states: wp.array[wp.uint8],
    width: int,
    room: int,
    stack: wp.array[wp.vec2i],
    mask: wp.array[wp.uint8],
):
    """Keep the pixels that are connected with pixels of at least a given state."""


@wp.func_native("__builtin_memset(mask.data + start, 0, stop - start);")
def forget(start: int, stop: int, mask: wp.array[wp.uint8]):
    """Set pixels from `start` to `stop` to 0."""


@wp.func
def measured(dy: f32_wide, dx: f32_wide, norm: int, root: bool) -> f32_wide:
    """Return the values that neighbours are compared by."""
    m = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy)
    if norm == Norm.L1:
        for k in range(WIDE):
            m[k] = wp.abs(dx[k]) + wp.abs(dy[k])
    elif root:
        for k in range(WIDE):
            m[k] = wp.sqrt(m[k])
    return m


@wp.func
def clear(line: int, lines: wp.array2d[float]):
    """Clear a line: the gradient outside the image is 0."""
    for x in range(lines.shape[1]):
        lines[line, x] = 0.0


@wp.func
def close(line: int, columns: int, lines: wp.array2d[float]):
    """Clear the margins of a line: the gradient beside a row is 0."""
    lines[line, 0] = 0.0
    lines[line, columns + 1] = 0.0


@wp.func
def clear_frame(y: int, states: wp.array2d[wp.uint8]):
    """Remove edges from the outermost rows and columns."""
    last = states.shape[1] - 1
    if y == 0 or y == states.shape[0] - 1:
        for x in range(last + 1):
            states[y, x] = wp.uint8(0)
    states[y, 0] = wp.uint8(0)
    states[y, last] = wp.uint8(0)


@wp.kernel
def thin_sobel(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[u8_wide],  # (H, N - 63)
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    # scratch
    lines: wp.array2d[float],  # (LINES slabs, N + 2)
    wide: wp.array2d[f32_wide],  # (LINES slabs, N + 2 - 63): the same
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    height = states.shape[0]
    columns = states.shape[1]
    both = wp.vec2(low, high)
    base = LINES * slab
    measures = base + MEASURES
    ends = wp.vec2i(border_index(-1, columns, border), border_index(columns, columns, border))
    for begin in range(0, columns, STRIP):
        end = wp.min(begin + STRIP, columns)
        strip = wp.vec2i(begin, end)
        for y in range(first - 1, last + 1):
            if y < 0 or y >= height:
                clear(measures + (y + 3) % 3, lines)
            else:
                above = border_index(y - 1, height, border)
                beside = wp.vec2i(above, border_index(y + 1, height, border))
                sobel_row(
                    y, src, beside, ends, wp.vec3i(begin, end, columns), cval, norm, lines, base
                )
            if y > first:
                third = (y + 2) % 3
                rows = wp.vec3i(base + DOWN + third, base + ALONG + third, measures)
                thin_in_sectors(y - 1, wide, wide, 1, wide, rows, strip, norm, both, False, states)


@wp.kernel
def thin(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_wide],  # (H, N - 63)
    dx: wp.array2d[f32_wide],  # (H, N - 63)
    norm: int,
    rule: int,
    limits: wp.array[float],  # (2,): what a weak and a strong pixel exceed
    # scratch
    lines: wp.array2d[float],  # (MEASURE_LINES slabs, N + 2)
    wide: wp.array2d[f32_wide],  # (MEASURE_LINES slabs, N + 2 - 63): the same
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    both = wp.vec2(limits[0], limits[1])
    framed = rule == Thinning.FRAMED
    columns = states.shape[1]
    behind = dy.shape[1] - 1
    measures = MEASURE_LINES * slab
    for y in range(first - 1, last + 1):
        line = measures + (y + 3) % 3
        if y < 0 or y >= states.shape[0]:
            clear(line, lines)
        else:
            for begin in range(0, behind + WIDE, WIDE):
                x = wp.min(begin, behind)
                root = rule != Thinning.SECTORS
                wide[line, x + 1] = measured(dy[y, x], dx[y, x], norm, root)
            close(line, columns, lines)
        if y > first:
            rows = wp.vec3i(y - 1, y - 1, measures)
            row = wp.vec2i(0, columns)
            if rule == Thinning.SECTORS:
                thin_in_sectors(y - 1, dy, dx, 0, wide, rows, row, norm, both, False, states)
            else:
                thin_between(y - 1, dy, dx, 0, wide, rows, row, norm, both, framed, states)
                if framed:
                    clear_frame(y - 1, states)


@wp.kernel
def flood_slab(
    slab: int,
    first: int,
    last: int,
    states: wp.array[wp.uint8],  # (H W,)
    width: int,
    # scratch
    stack: wp.array[wp.vec2i],  # (H W + slabs,): a slab's part is one larger than the slab
    # outputs
    mask: wp.array[wp.uint8],  # (H W,)
):
    # Keep the pixels that are connected with a strong pixel within the slab.
    start = first * width
    stop = last * width
    forget(start, stop, mask)
    flood(start, stop, Edge.STRONG, start, stop, states, width, start + slab, stack, mask)


@wp.kernel
def flood_seams(
    slabs: int,
    states: wp.array[wp.uint8],  # (H W,)
    width: int,
    # scratch
    stack: wp.array[wp.vec2i],  # (H W + slabs,)
    # outputs
    mask: wp.array[wp.uint8],  # (H W,)
):
    # Continue the fills that stopped at a seam between slabs, through the whole image.
    height = mask.shape[0] // width
    for seam in range(1, slabs):
        below = height * seam // slabs * width
        for i in range(below - width, below + width):
            if mask[i] != wp.uint8(0):
                other = wp.where(i < below, i + width, i - width)
                x = i % width
                for step in range(wp.max(-1, -x), wp.min(2, width - x)):
                    j = other + step
                    if states[j] != wp.uint8(0) and mask[j] == wp.uint8(0):
                        flood(j, j + 1, Edge.WEAK, 0, mask.shape[0], states, width, 0, stack, mask)
