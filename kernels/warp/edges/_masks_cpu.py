"""Edges on the CPU: one thread a slab of rows, a row at a time.

What is done to each pixel of a row is C (`wp.func_native`), because it becomes vector code as it
stands. In Warp's own language a loop over pixels stays scalar, and a vector of lanes whose elements
are chosen one by one goes through memory: both were measured at two to five times the time.
_masks_cuda.py has the same rules in Warp.
"""

import warp as wp

from cvkern.kernels.codes.edges import SECTOR_HIGH, SECTOR_LOW, SECTOR_ONE, Edge, Thinning
from cvkern.kernels.warp._borders import border_index

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Scratch of each slab is lines of W + 2 floats: pixel x stands at x + 1, between margins of one.
# Of rows y - 1, y and y + 1 a slab holds row r in line r mod 3.


@wp.func_native("""
    // Weights 1 2 1 and -1 0 1 down each column of the row.
    #pragma clang fp contract(off)
    const int columns = src.shape[1], pitch = sums.shape[1];
    const unsigned char* b = src.data + (size_t)y * columns;
    const unsigned char* a = above < 0 ? b : src.data + (size_t)above * columns;
    const unsigned char* c = below < 0 ? b : src.data + (size_t)below * columns;
    float* __restrict__ sum = sums.data + (size_t)slab * pitch + 1;
    float* __restrict__ difference = differences.data + (size_t)slab * pitch + 1;
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < columns; ++x) {
        const float over = a[x], here = b[x], under = c[x];
        const float up = above < 0 ? cval : over, down = below < 0 ? cval : under;
        sum[x] = up + here + here + down;
        difference[x] = down - up;
    }
""")
def sobel_columns(
    src: wp.array2d[wp.uint8],
    y: int,
    above: int,
    below: int,
    cval: float,
    slab: int,
    sums: wp.array2d[float],
    differences: wp.array2d[float],
): ...


@wp.func_native("""
    // Weights -1 0 1 and 1 2 1 along the row of the sums and the differences.
    #pragma clang fp contract(off)
    const int pitch = sums.shape[1];
    const float* sum = sums.data + (size_t)slab * pitch + 1;
    const float* difference = differences.data + (size_t)slab * pitch + 1;
    float* __restrict__ down = dy.data + (size_t)line * pitch + 1;
    float* __restrict__ along = dx.data + (size_t)line * pitch + 1;
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < pitch - 2; ++x) {
        down[x] = difference[x - 1] + difference[x] + difference[x] + difference[x + 1];
        along[x] = sum[x + 1] - sum[x - 1];
    }
""")
def sobel_row(
    slab: int,
    sums: wp.array2d[float],
    differences: wp.array2d[float],
    line: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
): ...


@wp.func_native("""
    // What neighbours are compared by; 0 in the margins, outside the image. Norm.L1 is 0.
    #pragma clang fp contract(off)
    const int pitch = measures.shape[1];
    const float* down = dy.data + (size_t)row * dy.shape[1] + margin;
    const float* along = dx.data + (size_t)row * dx.shape[1] + margin;
    float* __restrict__ m = measures.data + (size_t)line * pitch + 1;
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < pitch - 2; ++x) {
        const float l1 = __builtin_fabsf(along[x]) + __builtin_fabsf(down[x]);
        const float square = along[x] * along[x] + down[x] * down[x];
        m[x] = norm == 0 ? l1 : root ? wp::sqrt(square) : square;
    }
    m[-1] = m[pitch - 2] = 0.0f;
""")
def measure_row(
    row: int,
    margin: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    norm: int,
    root: bool,
    line: int,
    measures: wp.array2d[float],
): ...


# The rule of _thinning_cuda.py; the letters are those of a compass. All neighbours are read, or the
# choice among them would keep the loop from vector code.
_THIN = """
    #pragma clang fp contract(off)
    const int pitch = measures.shape[1], columns = pitch - 2;
    const float* down = dy.data + (size_t)row * dy.shape[1] + margin;
    const float* along = dx.data + (size_t)row * dx.shape[1] + margin;
    const float* above = measures.data + (size_t)(3 * slab + (y + 2) % 3) * pitch + 1;
    const float* here = measures.data + (size_t)(3 * slab + y % 3) * pitch + 1;
    const float* below = measures.data + (size_t)(3 * slab + (y + 1) % 3) * pitch + 1;
    unsigned char* __restrict__ state = states.data + (size_t)y * columns;
    const float least = LEAST;  // at most what a pixel above `low` is compared by
    for (int begin = 0; begin < columns; begin += 64) {
    const int end = begin + 64 < columns ? begin + 64 : columns;
    int found = 0;  // nothing in most of a photograph
    for (int x = begin; x < end; ++x) found |= here[x] > least;
    if (!found) {
        for (int x = begin; x < end; ++x) state[x] = 0;
        continue;
    }
    #pragma clang loop vectorize(assume_safety)
    for (int x = begin; x < end; ++x) {
        const float nw = above[x - 1], n = above[x], ne = above[x + 1];
        const float w = here[x - 1], c = here[x], e = here[x + 1];
        const float sw = below[x - 1], s = below[x], se = below[x + 1];
        const float ax = __builtin_fabsf(along[x]), ay = __builtin_fabsf(down[x]);
        const bool opposite = (along[x] < 0.0f) != (down[x] < 0.0f);
        RULE
        const float m = norm == 0 ? ax + ay : along[x] * along[x] + down[x] * down[x];
        state[x] = (kept & (m > low)) ? 1 + (m > high) : 0;
    }
    }
"""

_IN_SECTOR = f"""
        const float steep = ay * {SECTOR_ONE}f;
        const bool across = steep < ax * {SECTOR_LOW}f, downward = steep > ax * {SECTOR_HIGH}f;
        const float back = across ? w : downward ? n : opposite ? ne : nw;
        const float ahead = across ? e : downward ? s : opposite ? sw : se;
        const bool kept = (c > back) & ((c > ahead) | ((across | downward) & (c == ahead)));
"""

_BETWEEN = """
        const bool downward = ay > ax;
        const float large = downward ? ay : ax, small = downward ? ax : ay, rest = large - small;
        const float corner_back = opposite ? (downward ? ne : sw) : nw;
        const float corner_ahead = opposite ? (downward ? sw : ne) : se;
        const float back = (downward ? n : w) * rest + corner_back * small;
        const float ahead = (downward ? s : e) * rest + corner_ahead * small;
        const float top = c * large;
        const bool kept = ((top > back) | (framed & (top == back))) & (top >= ahead);
"""


@wp.func_native(_THIN.replace("RULE", _IN_SECTOR).replace("LEAST", "low"))
def thin_in_sectors(
    slab: int,
    y: int,
    row: int,
    margin: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    measures: wp.array2d[float],
    norm: int,
    low: float,
    high: float,
    states: wp.array2d[wp.uint8],
): ...


# Rounding a root keeps order, but may make two one: hence not the root of `low` itself.
@wp.func_native(
    _THIN.replace("RULE", _BETWEEN).replace("LEAST", "norm == 0 ? low : 0.999f * wp::sqrt(low)")
)
def thin_between(
    slab: int,
    y: int,
    row: int,
    margin: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    measures: wp.array2d[float],
    norm: int,
    low: float,
    high: float,
    framed: bool,
    states: wp.array2d[wp.uint8],
): ...


@wp.func
def clear(line: int, lines: wp.array2d[float]):
    """Outside the image there is no gradient."""
    for x in range(lines.shape[1]):
        lines[line, x] = 0.0


@wp.func
def clear_frame(y: int, states: wp.array2d[wp.uint8]):
    """Leave no edge on the outermost rows and columns."""
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
    src: wp.array2d[wp.uint8],  # (H, W)
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    # scratch
    sums: wp.array2d[float],  # (slabs, W + 2)
    differences: wp.array2d[float],  # (slabs, W + 2)
    dy: wp.array2d[float],  # (3 slabs, W + 2)
    dx: wp.array2d[float],  # (3 slabs, W + 2)
    measures: wp.array2d[float],  # (3 slabs, W + 2)
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    height = src.shape[0]
    columns = src.shape[1]
    for y in range(first - 1, last + 1):
        line = 3 * slab + (y + 3) % 3
        if y < 0 or y >= height:
            clear(line, measures)
        else:
            above = border_index(y - 1, height, border)
            below = border_index(y + 1, height, border)
            sobel_columns(src, y, above, below, cval, slab, sums, differences)
            for side in range(2):
                x = wp.where(side == 0, -1, columns)
                inside = border_index(x, columns, border)
                sums[slab, x + 1] = wp.where(
                    inside < 0, 4.0 * cval, sums[slab, wp.max(inside, 0) + 1]
                )
                differences[slab, x + 1] = wp.where(
                    inside < 0, 0.0, differences[slab, wp.max(inside, 0) + 1]
                )
            sobel_row(slab, sums, differences, line, dy, dx)
            measure_row(line, 1, dy, dx, norm, False, line, measures)
        if y > first:
            row = 3 * slab + (y + 2) % 3
            thin_in_sectors(slab, y - 1, row, 1, dy, dx, measures, norm, low, high, states)


@wp.kernel
def thin(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    norm: int,
    rule: int,
    limits: wp.array[float],  # (2,): what a weak and a strong pixel exceed
    # scratch
    measures: wp.array2d[float],  # (3 slabs, W + 2)
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    low = limits[0]
    high = limits[1]
    framed = rule == Thinning.FRAMED
    for y in range(first - 1, last + 1):
        line = 3 * slab + (y + 3) % 3
        if y < 0 or y >= dy.shape[0]:
            clear(line, measures)
        else:
            measure_row(y, 0, dy, dx, norm, rule != Thinning.SECTORS, line, measures)
        if y > first:
            if rule == Thinning.SECTORS:
                thin_in_sectors(slab, y - 1, y - 1, 0, dy, dx, measures, norm, low, high, states)
            else:
                thin_between(
                    slab, y - 1, y - 1, 0, dy, dx, measures, norm, low, high, framed, states
                )
                if framed:
                    clear_frame(y - 1, states)


@wp.func_native("""
    // Keep all that is 8-connected, between pixels start and stop, with a pixel from first to last
    // whose state is at least `least`.
    const unsigned char* state = states.data;
    unsigned char* kept = mask.data;
    wp::vec_t<2, int>* const bottom = stack.data + room;  // of pixels and their columns
    for (int i = first; i < last; ++i) {
        unsigned long long eight = 0;
        while (i + 8 <= last) {  // pass over what has no such state
            __builtin_memcpy(&eight, state + i, 8);
            if (eight & (least == 2 ? 0x0202020202020202ull : 0x0303030303030303ull)) break;
            i += 8;
        }
        if (i == last) break;
        if (state[i] < least || kept[i]) continue;
        wp::vec_t<2, int>* top = bottom;
        kept[i] = 1;
        *top++ = wp::vec_t<2, int>(i, i % width);
        while (top > bottom) {
            const wp::vec_t<2, int> pixel = *--top;
            const int x = pixel[1], left = x > 0 ? -1 : 0, right = x + 1 < width ? 1 : 0;
            for (int row = pixel[0] - width; row <= pixel[0] + width; row += width) {
                if (row - x < start || row - x >= stop) continue;
                for (int dx = left; dx <= right; ++dx) {
                    // Without a branch, which nothing could predict.
                    const unsigned char next = (state[row + dx] != 0) & (kept[row + dx] == 0);
                    kept[row + dx] |= next;
                    *top = wp::vec_t<2, int>(row + dx, x + dx);
                    top += next;
                }
            }
        }
    }
""")
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
): ...


@wp.func_native("""
    __builtin_memset(mask.data + start, 0, stop - start);
""")
def forget(start: int, stop: int, mask: wp.array[wp.uint8]): ...


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
    # Keep what is connected with a strong pixel within the slab.
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
    # Carry on, through the whole image, what a seam between slabs has stopped.
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
