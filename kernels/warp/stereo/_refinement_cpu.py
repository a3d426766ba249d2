"""Refinement of disparities on the CPU: one thread a slab of rows, in C."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MAX_RADIUS = 15


_CHECK = """
    const int columns = disparity.shape[1];
    const float* from = disparity.data + (size_t)row * columns;
    const TYPE* other = right.data + (size_t)row * columns;
    float* to = checked.data + (size_t)row * columns;
    const float none = __builtin_nanf("");
    for (int x = 0; x < columns; ++x) {
        const float d = from[x], at = x - __builtin_floorf(d + 0.5f);
        const bool inside = at >= 0.0f && at < columns;
        const TYPE match = other[inside ? (int)at : 0];
        const bool kept = inside && EXISTS && __builtin_fabsf(d - MATCH) <= tolerance;
        to[x] = kept ? d : none;
    }
"""


def _left_right(scalar: Any, c_type: str, exists: str, match: str) -> wp.Kernel:
    """Return the kernel for right disparities of one type."""
    text = _CHECK.replace("TYPE", c_type).replace("EXISTS", exists).replace("MATCH", match)

    @wp.func_native(text)
    def check_row(
        disparity: wp.array2d[float],
        row: int,
        right: wp.array2d[scalar],
        first: int,
        tolerance: float,
        checked: wp.array2d[float],
    ): ...

    @wp.kernel
    def left_right(
        slab: int,
        begin: int,
        end: int,
        disparity: wp.array2d[float],  # (H, W)
        right: wp.array2d[scalar],  # (H, W)
        first: int,
        tolerance: float,
        # outputs
        checked: wp.array2d[float],  # (H, W)
    ):
        for row in range(begin, end):
            check_row(disparity, row, right, first, tolerance, checked)

    return left_right


left_rights = {
    wp.int32: _left_right(wp.int32, "int", "match >= 0", "(float)(first + match)"),
    wp.float32: _left_right(wp.float32, "float", "true", "match"),
}


# Speckles. A run is what is connected within a row; its label is its first pixel. Runs hang below
# others of their region, and that on top has the size of all.


@wp.func_native("""
    const int columns = disparity.shape[1];
    const float* d = disparity.data;
    for (int i = row * columns, start = i, x = 0; x < columns; ++x, ++i) {
        if (x == 0 || !(__builtin_fabsf(d[i] - d[i - 1]) <= difference)) {
            start = i;
            parents.data[i] = i;
            sizes.data[i] = 0;
        }
        labels.data[i] = start;
        ++sizes.data[start];
    }
""")
def find_runs(
    disparity: wp.array2d[float],
    row: int,
    difference: float,
    labels: wp.array[int],
    parents: wp.array[int],
    sizes: wp.array[int],
): ...


@wp.func_native("""
    // Join the runs of a row with those of the row above.
    const int columns = disparity.shape[1];
    const float* d = disparity.data;
    int* parent = parents.data;
    int last = -1, last_above = -1;
    for (int i = row * columns; i < (row + 1) * columns; ++i) {
        const int up = i - columns;
        if (!(__builtin_fabsf(d[i] - d[up]) <= difference)) continue;
        int a = labels.data[i], b = labels.data[up];
        if (a == last && b == last_above) continue;
        last = a;
        last_above = b;
        while (parent[a] != a) a = parent[a] = parent[parent[a]];
        while (parent[b] != b) b = parent[b] = parent[parent[b]];
        if (a == b) continue;
        const int root = a < b ? a : b, other = a < b ? b : a;
        parent[other] = root;
        sizes.data[root] += sizes.data[other];
    }
""")
def join_rows(
    disparity: wp.array2d[float],
    row: int,
    difference: float,
    labels: wp.array[int],
    parents: wp.array[int],
    sizes: wp.array[int],
): ...


@wp.func_native("""
    const int columns = disparity.shape[1];
    const float none = __builtin_nanf("");
    bool large = false;
    for (int i = row * columns; i < (row + 1) * columns; ++i) {
        int label = labels.data[i];
        if (label == i) {
            while (parents.data[label] != label) label = parents.data[label];
            large = sizes.data[label] >= min_size;
        }
        kept.data[i] = large ? disparity.data[i] : none;
    }
""")
def keep_large(
    disparity: wp.array2d[float],
    row: int,
    min_size: int,
    labels: wp.array[int],
    parents: wp.array[int],
    sizes: wp.array[int],
    kept: wp.array2d[float],
): ...


@wp.kernel
def label_slab(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    for row in range(first, last):
        find_runs(disparity, row, difference, labels, parents, sizes)
        if row > first:
            join_rows(disparity, row, difference, labels, parents, sizes)


@wp.kernel
def join_slabs(
    slabs: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    labels: wp.array[int],  # (H W,)
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    for seam in range(1, slabs):
        row = disparity.shape[0] * seam // slabs
        join_rows(disparity, row, difference, labels, parents, sizes)


@wp.kernel
def keep_regions(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    min_size: int,
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
    # outputs
    kept: wp.array2d[float],  # (H, W)
):
    for row in range(first, last):
        keep_large(disparity, row, min_size, labels, parents, sizes, kept)


@wp.func_native("""
    const int columns = disparity.shape[1];
    const float* from = disparity.data + (size_t)row * columns;
    float* to = filled.data + (size_t)row * columns;
    unsigned char* is = valid.data + (size_t)row * columns;
    const float infinite = __builtin_inff();
    float nearest = infinite;
    for (int x = 0; x < columns; ++x) {
        is[x] = __builtin_fabsf(from[x]) < infinite;
        nearest = is[x] ? from[x] : nearest;
        to[x] = nearest;
    }
    found.data[row] = nearest < infinite;
    nearest = infinite;
    for (int x = columns - 1; x >= 0; --x) {
        nearest = is[x] ? to[x] : nearest;
        to[x] = nearest < to[x] ? nearest : to[x];
    }
""")
def fill_row(
    disparity: wp.array2d[float],
    row: int,
    filled: wp.array2d[float],
    valid: wp.array2d[wp.uint8],
    found: wp.array[int],
): ...


@wp.kernel
def fill(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    # outputs
    filled: wp.array2d[float],  # (H, W)
    valid: wp.array2d[wp.uint8],  # (H, W)
    found: wp.array[int],  # (H,)
):
    for row in range(first, last):
        fill_row(disparity, row, filled, valid, found)


@wp.kernel
def find_sources(
    # outputs
    found: wp.array[int],  # (H,): 1 for rows with a disparity; then the row to fill from, or -1
):
    # One thread: a row needs what the one before has found.
    height = found.shape[0]
    first = int(0)
    while first < height and found[first] == 0:
        first += 1
    source = wp.where(first < height, first, -1)
    for row in range(height):
        if found[row] != 0:
            source = row
        found[row] = source


@wp.kernel
def fill_empty_rows(
    slab: int,
    first: int,
    last: int,
    found: wp.array[int],  # (H,)
    # outputs
    filled: wp.array2d[float],  # (H, W)
):
    for row in range(first, last):
        source = found[row]
        if source != row:
            for x in range(filled.shape[1]):
                filled[row, x] = wp.where(source >= 0, filled[wp.max(source, 0), x], wp.nan)


# The weighted median: of the values in the window, in ascending order and those of equal ones in
# the order of their places, the first whose weight and that of all before it is at least half of
# the whole. Each pair is compared once, for a row of pixels at a time.
_MEDIAN = """
    for (; begin + LANES <= columns; begin += LANES) {
        float v[MOST][LANES], best[LANES];
        int weight[MOST][LANES], sum[MOST][LANES], total[LANES];
        for (int k = 0; k < LANES; ++k) total[k] = 0;
        for (int i = 0; i < size; ++i) {
            const float* value = values[i] + begin;
            const unsigned char* near = grays[i] + begin;
            const unsigned char* center = grays[radius] + begin;
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const int unlike = near[k] < center[k] ? center[k] - near[k] : near[k] - center[k];
                const int say = contrast - unlike > 1 ? contrast - unlike : 1;
                v[i][k] = value[k] + 0.0f;
                weight[i][k] = sum[i][k] = value[k] == value[k] ? say : 0;
                total[k] += weight[i][k];
            }
        }
        for (int i = 0; i < size; ++i)
            for (int j = i + 1; j < size; ++j) {
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < LANES; ++k) {
                    const bool before = v[i][k] <= v[j][k];
                    sum[j][k] += before ? weight[i][k] : 0;
                    sum[i][k] += before ? 0 : weight[j][k];
                }
            }
        for (int k = 0; k < LANES; ++k) best[k] = __builtin_nanf("");
        for (int i = 0; i < size; ++i) {
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const bool enough = weight[i][k] > 0 && 2 * sum[i][k] >= total[k];
                best[k] = enough && !(best[k] <= v[i][k]) ? v[i][k] : best[k];
            }
        }
        for (int k = 0; k < LANES; ++k) to[begin + k] = best[k];
    }
"""

_BLOCKS = "int begin = 0;" + _MEDIAN.replace("LANES", "16") + _MEDIAN.replace("LANES", "1")

_ALONG = """
    const int columns = disparity.shape[1], size = 2 * radius + 1;
    const float* from = disparity.data + (size_t)row * columns;
    const unsigned char* gray = guide.data + (size_t)row * columns;
    float* to = smooth.data + (size_t)row * columns;
    float* line = lines.data + (size_t)slab * lines.shape[1];
    unsigned char* gray_line = gray_lines.data + (size_t)slab * gray_lines.shape[1];
    for (int x = 0; x < columns + 2 * radius; ++x) {
        const int i = x - radius < 0 ? 0 : x - radius < columns ? x - radius : columns - 1;
        line[x] = from[i];
        gray_line[x] = gray[i];
    }
    const float* values[MOST];
    const unsigned char* grays[MOST];
    for (int i = 0; i < size; ++i) {
        values[i] = line + i;
        grays[i] = gray_line + i;
    }
"""

_DOWN = """
    const int height = disparity.shape[0], columns = disparity.shape[1], size = 2 * radius + 1;
    float* to = smooth.data + (size_t)row * columns;
    const float* values[MOST];
    const unsigned char* grays[MOST];
    for (int i = 0; i < size; ++i) {
        const int y = row + i - radius, inside = y < 0 ? 0 : y < height ? y : height - 1;
        values[i] = disparity.data + (size_t)inside * columns;
        grays[i] = guide.data + (size_t)inside * columns;
    }
"""


@wp.func_native((_ALONG + _BLOCKS).replace("MOST", str(2 * MAX_RADIUS + 1)))
def median_along(
    slab: int,
    disparity: wp.array2d[float],
    row: int,
    guide: wp.array2d[wp.uint8],
    radius: int,
    contrast: int,
    lines: wp.array2d[float],
    gray_lines: wp.array2d[wp.uint8],
    smooth: wp.array2d[float],
): ...


@wp.func_native((_DOWN + _BLOCKS).replace("MOST", str(2 * MAX_RADIUS + 1)))
def median_down(
    disparity: wp.array2d[float],
    row: int,
    guide: wp.array2d[wp.uint8],
    radius: int,
    contrast: int,
    smooth: wp.array2d[float],
): ...


@wp.kernel
def medians_along(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    guide: wp.array2d[wp.uint8],  # (H, W)
    radius: int,
    contrast: int,
    # scratch
    lines: wp.array2d[float],  # (slabs, W + 2 radius)
    gray_lines: wp.array2d[wp.uint8],  # (slabs, W + 2 radius)
    # outputs
    smooth: wp.array2d[float],  # (H, W)
):
    for row in range(first, last):
        median_along(slab, disparity, row, guide, radius, contrast, lines, gray_lines, smooth)


@wp.kernel
def medians_down(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    guide: wp.array2d[wp.uint8],  # (H, W)
    radius: int,
    contrast: int,
    # outputs
    smooth: wp.array2d[float],  # (H, W)
):
    for row in range(first, last):
        median_down(disparity, row, guide, radius, contrast, smooth)
