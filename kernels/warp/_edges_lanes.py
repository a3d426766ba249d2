"""Edges on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from ..codes import Edge, Thinning
from ._borders import border_index
from ._lanes import LANES, f32_lanes, u8_lanes
from ._thinning import compared, is_maximum_between, is_maximum_in_sector, measure

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Lines of scratch for each slab: three rows each of dy, dx and what is compared (row y in line
# y mod 3), then the column sums and differences that a row of Sobel is made of. Pixel x stands at
# x + 1, between margins of one pixel.
DY = wp.constant(0)
DX = wp.constant(3)
MEASURE = wp.constant(6)
SUM = wp.constant(9)
DIFFERENCE = wp.constant(10)
LINES = 11


@wp.kernel
def thin_sobel(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[u8_lanes],  # (H, W)
    stored: int,
    columns: int,
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    # scratch
    lines: wp.array3d[float],  # (slabs, LINES, W + 2)
    line_lanes: wp.array3d[f32_lanes],
    # outputs
    states: wp.array2d[u8_lanes],  # (H, W)
):
    height = src.shape[0]
    for y in range(first - 1, last + 1):
        slot = (y + 3) % 3
        if y < 0 or y >= height:
            clear(lines, slab, MEASURE + slot)
        else:
            above = border_index(y - 1, height, border)
            below = border_index(y + 1, height, border)
            for lane in range((stored + LANES - 1) // LANES):
                x = wp.min(lane * LANES, stored - LANES)
                a = f32_lanes(cval)
                if above >= 0:
                    a = f32_lanes(src[above, x])
                b = f32_lanes(src[y, x])
                c = f32_lanes(cval)
                if below >= 0:
                    c = f32_lanes(src[below, x])
                line_lanes[slab, SUM, x + 1] = a + b + b + c
                line_lanes[slab, DIFFERENCE, x + 1] = c - a
            for side in range(2):
                x = wp.where(side == 0, -1, columns)
                inside = border_index(x, columns, border)
                if inside < 0:
                    lines[slab, SUM, x + 1] = 4.0 * cval
                    lines[slab, DIFFERENCE, x + 1] = 0.0
                else:
                    lines[slab, SUM, x + 1] = lines[slab, SUM, inside + 1]
                    lines[slab, DIFFERENCE, x + 1] = lines[slab, DIFFERENCE, inside + 1]
            for lane in range((stored + LANES - 1) // LANES):
                x = wp.min(lane * LANES, stored - LANES)
                dx = line_lanes[slab, SUM, x + 2] - line_lanes[slab, SUM, x]
                d = line_lanes[slab, DIFFERENCE, x + 1]
                dy = line_lanes[slab, DIFFERENCE, x] + d + d + line_lanes[slab, DIFFERENCE, x + 2]
                keep(line_lanes, slab, slot, x, dy, dx, norm, Thinning.SECTORS)
            seal(lines, slab, slot, columns)
        if y > first:
            thin_row(line_lanes, slab, y - 1, stored, norm, Thinning.SECTORS, low, high, states)


@wp.kernel
def thin(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_lanes],  # (H, W)
    dx: wp.array2d[f32_lanes],  # (H, W)
    stored: int,
    columns: int,
    norm: int,
    rule: int,
    low: float,
    high: float,
    # scratch
    lines: wp.array3d[float],  # (slabs, LINES, W + 2)
    line_lanes: wp.array3d[f32_lanes],
    # outputs
    states: wp.array2d[u8_lanes],  # (H, W)
):
    height = dy.shape[0]
    for y in range(first - 1, last + 1):
        slot = (y + 3) % 3
        if y < 0 or y >= height:
            clear(lines, slab, MEASURE + slot)
        else:
            for lane in range((stored + LANES - 1) // LANES):
                x = wp.min(lane * LANES, stored - LANES)
                keep(line_lanes, slab, slot, x, dy[y, x], dx[y, x], norm, rule)
            seal(lines, slab, slot, columns)
        if y > first:
            thin_row(line_lanes, slab, y - 1, stored, norm, rule, low, high, states)


@wp.func
def keep(
    lines: wp.array3d[f32_lanes],
    slab: int,
    slot: int,
    x: int,
    dy: f32_lanes,
    dx: f32_lanes,
    norm: int,
    rule: int,
):
    """Store a vector of gradients, and of what their lengths are compared by."""
    m = f32_lanes()
    for k in range(LANES):
        m[k] = compared(measure(dy[k], dx[k], norm), norm, rule)
    lines[slab, DY + slot, x + 1] = dy
    lines[slab, DX + slot, x + 1] = dx
    lines[slab, MEASURE + slot, x + 1] = m


@wp.func
def clear(lines: wp.array3d[float], slab: int, line: int):
    """Outside the image there is no gradient."""
    for x in range(lines.shape[2]):
        lines[slab, line, x] = 0.0


@wp.func
def seal(lines: wp.array3d[float], slab: int, slot: int, columns: int):
    """Clear the margins of a row, which lanes may have run over."""
    lines[slab, MEASURE + slot, 0] = 0.0
    lines[slab, MEASURE + slot, columns + 1] = 0.0


@wp.func
def thin_row(
    lines: wp.array3d[f32_lanes],
    slab: int,
    y: int,
    stored: int,
    norm: int,
    rule: int,
    low: float,
    high: float,
    states: wp.array2d[u8_lanes],
):
    """Write the states of row `y` from its line and the lines above and below."""
    here = y % 3
    above = (y + 2) % 3
    below = (y + 1) % 3
    for lane in range((stored + LANES - 1) // LANES):
        x = wp.min(lane * LANES, stored - LANES)
        dy = lines[slab, DY + here, x + 1]
        dx = lines[slab, DX + here, x + 1]
        nw = lines[slab, MEASURE + above, x]
        n = lines[slab, MEASURE + above, x + 1]
        ne = lines[slab, MEASURE + above, x + 2]
        w = lines[slab, MEASURE + here, x]
        c = lines[slab, MEASURE + here, x + 1]
        e = lines[slab, MEASURE + here, x + 2]
        sw = lines[slab, MEASURE + below, x]
        s = lines[slab, MEASURE + below, x + 1]
        se = lines[slab, MEASURE + below, x + 2]
        state = f32_lanes()
        if rule == Thinning.SECTORS:
            for k in range(LANES):
                m = measure(dy[k], dx[k], norm)
                kept = is_maximum_in_sector(
                    dy[k], dx[k], nw[k], n[k], ne[k], w[k], c[k], e[k], sw[k], s[k], se[k]
                )
                strength = wp.where(m > low, 1.0, 0.0) + wp.where(m > high, 1.0, 0.0)
                state[k] = wp.where(kept, strength, 0.0)
        else:
            for k in range(LANES):
                m = measure(dy[k], dx[k], norm)
                kept = is_maximum_between(
                    dy[k], dx[k], nw[k], n[k], ne[k], w[k], c[k], e[k], sw[k], s[k], se[k]
                )
                strength = wp.where(m > low, 1.0, 0.0) + wp.where(m > high, 1.0, 0.0)
                state[k] = wp.where(kept, strength, 0.0)
        states[y, x] = u8_lanes(state)


@wp.kernel
def flood_slab(
    slab: int,
    first: int,
    last: int,
    states: wp.array[wp.uint8],  # (H W,)
    words: wp.array[wp.uint64],  # the same bytes, eight at a time
    width: int,
    # scratch
    stack: wp.array[int],  # (H W,): a slab's part is as large as the slab
    # outputs
    mask: wp.array[wp.uint8],  # (H W,), zeros
):
    # Grow every strong pixel within the slab.
    start = first * width
    stop = last * width
    for word in range(start // 8, (stop + 7) // 8):
        if word >= words.shape[0] or words[word] != wp.uint64(0):
            for i in range(wp.max(word * 8, start), wp.min(word * 8 + 8, stop)):
                if int(states[i]) == Edge.STRONG and mask[i] == wp.uint8(0):
                    flood(i, start, stop, states, width, stack, mask)


@wp.kernel
def flood_seams(
    slabs: int,
    states: wp.array[wp.uint8],  # (H W,)
    width: int,
    # scratch
    stack: wp.array[int],  # (H W,)
    # outputs
    mask: wp.array[wp.uint8],  # (H W,)
):
    # Carry on, through the whole image, what a seam between slabs has stopped.
    height = mask.shape[0] // width
    for seam in range(1, slabs):
        below = height * seam // slabs * width
        for i in range(below - width, below + width):
            if mask[i] == wp.uint8(1):
                other = wp.where(i < below, i + width, i - width)
                x = i % width
                for step in range(wp.max(-1, -x), wp.min(2, width - x)):
                    j = other + step
                    if states[j] != wp.uint8(0) and mask[j] == wp.uint8(0):
                        flood(j, 0, mask.shape[0], states, width, stack, mask)


@wp.func
def flood(
    seed: int,
    start: int,
    stop: int,
    states: wp.array[wp.uint8],
    width: int,
    stack: wp.array[int],
    mask: wp.array[wp.uint8],
):
    """Mark all that is 8-connected with `seed` between pixels `start` and `stop`."""
    mask[seed] = wp.uint8(1)
    stack[start] = seed
    top = int(start + 1)
    while top > start:
        top -= 1
        i = stack[top]
        x = i % width
        for dy in range(-1, 2):
            for dx in range(wp.max(-1, -x), wp.min(2, width - x)):
                j = i + dy * width + dx
                if j >= start and j < stop:
                    if states[j] != wp.uint8(0) and mask[j] == wp.uint8(0):
                        mask[j] = wp.uint8(1)
                        stack[top] = j
                        top += 1
