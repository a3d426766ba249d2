"""From edge points to circles on the CPU.

What is done to each point is C (`wp.func_native`), because most of it becomes vector code as it
stands. _detection_cuda.py has the same rules in Warp.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.hough import ARCS, FINE_ONE, LINE_ONE, NORMAL_ONE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SHRINK = """
    const int columns = dst.shape[1], width = src.shape[1], used = columns * factor;
    float* __restrict__ line = lines.data + (size_t)slab * width;
    const float share = 1.0f / (factor * factor);
    for (int v = 0; v < factor; ++v) {
        const TYPE* from = src.data + ((size_t)row * factor + v) * width;
        #pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < used; ++x) line[x] = (v ? line[x] : 0.0f) + from[x];
    }
    for (int x = 0; x < columns; ++x) {
        float sum = 0.0f;
        for (int u = 0; u < factor; ++u) sum += line[x * factor + u];
        dst.data[(size_t)row * columns + x] = sum * share;
    }
"""


def _shrink(scalar: Any, c_type: str) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.func_native(_SHRINK.replace("TYPE", c_type))
    def shrink_row(
        slab: int,
        src: wp.array2d[scalar],
        row: int,
        factor: int,
        lines: wp.array2d[float],
        dst: wp.array2d[float],
    ): ...

    @wp.kernel
    def shrink(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[scalar],  # (H, W)
        factor: int,
        # scratch
        lines: wp.array2d[float],  # (slabs, W)
        # outputs
        dst: wp.array2d[float],  # (H // factor, W // factor)
    ):
        for row in range(first, last):
            shrink_row(slab, src, row, factor, lines, dst)

    return shrink


shrinks = {wp.uint8: _shrink(wp.uint8, "unsigned char"), wp.float32: _shrink(wp.float32, "float")}


# Between the pixels, the edge is at the top of the parabola through the lengths of the gradient
# along the axis that it is nearest to.
@wp.func_native("""
    #pragma clang fp contract(off)
    const int count = lines.shape[1], height = dy.shape[0], width = dy.shape[1];
    const auto length = [&](int y, int x) {
        const bool inside = y >= 0 && x >= 0 && y < height && x < width;
        const size_t at = inside ? (size_t)y * width + x : 0;
        const float square = dx.data[at] * dx.data[at] + dy.data[at] * dy.data[at];
        return inside ? wp::sqrt(square) : 0.0f;
    };
    for (int i = 0; i < count; ++i) {
        const int y = pixels.data[2 * i], x = pixels.data[2 * i + 1];
        const float down = dy.data[(size_t)y * width + x], along = dx.data[(size_t)y * width + x];
        const int steep = __builtin_fabsf(down) > __builtin_fabsf(along), flat = 1 - steep;
        const float before = length(y - steep, x - flat), here = length(y, x);
        const float behind = length(y + steep, x + flat);
        const bool peak = here > before && here >= behind;
        const float bend = peak ? before - 2.0f * here + behind : 1.0f;
        const float offset = peak ? 0.5f * (before - behind) / bend : 0.0f;
        lines.data[i] = y + (steep ? offset : 0.0f);
        lines.data[count + i] = x + (steep ? 0.0f : offset);
        lines.data[2 * count + i] = down / here;
        lines.data[3 * count + i] = along / here;
    }
""")
def aim_all(
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    pixels: wp.array2d[int],
    lines: wp.array2d[float],
): ...


@wp.kernel
def aim(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    pixels: wp.array2d[int],  # (N, 2)
    # outputs
    lines: wp.array2d[float],  # (4, N)
):
    aim_all(dy, dx, pixels, lines)


# A line is walked cell by cell in fixed point. `first_side` and `last_side` are 1 and -1: along
# the gradient, and against it.
@wp.func_native(f"""
    #pragma clang fp contract(off)
    const int count = lines.shape[1], height = votes.shape[1], width = votes.shape[2];
    const float* row = lines.data;
    const float* column = row + count;
    const float* down = column + count;
    const float* along = down + count;
    int* out = votes.data + (size_t)slab * height * width;
    for (int i = 0; i < height * width; ++i) out[i] = 0;
    for (int i = first; i < last; ++i) {{
        const int y = (int)__builtin_floorf(row[i] * scale + 0.5f) + {LINE_ONE // 2};
        const int x = (int)__builtin_floorf(column[i] * scale + 0.5f) + {LINE_ONE // 2};
        const int dy = (int)(down[i] * {LINE_ONE}.0f), dx = (int)(along[i] * {LINE_ONE}.0f);
        for (int side = first_side; side >= last_side; side -= 2) {{
            int v = y + side * low * dy, u = x + side * low * dx;
            for (int k = low; k <= high; ++k, v += side * dy, u += side * dx) {{
                const unsigned r = v >> {LINE_ONE.bit_length() - 1};
                const unsigned c = u >> {LINE_ONE.bit_length() - 1};
                if (r >= (unsigned)height || c >= (unsigned)width) break;
                ++out[r * width + c];
            }}
        }}
    }}
""")
def vote_lines(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    votes: wp.array3d[int],
): ...


@wp.kernel
def vote_centers(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    # outputs
    votes: wp.array3d[int],  # (slabs, H, W)
):
    vote_lines(slab, first, last, lines, low, high, scale, first_side, last_side, votes)


@wp.func_native("""
    const int columns = votes.shape[1];
    float* __restrict__ out = votes.data + (size_t)row * columns;
    for (int p = 0; p < parts.shape[0]; ++p) {
        const int* from = parts.data + ((size_t)p * parts.shape[1] + row) * columns;
        #pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < columns; ++x) out[x] = (p ? out[x] : 0.0f) + (wp::float32)from[x];
    }
""")
def add_row(parts: wp.array3d[int], row: int, votes: wp.array2d[float]): ...


@wp.kernel
def add_parts(
    parts: wp.array3d[int],  # (slabs, H, W)
    # outputs
    votes: wp.array2d[float],  # (H, W)
):
    for row in range(votes.shape[0]):
        add_row(parts, row, votes)


# Of 64 points at once: which are at a distance in [least, most] of a centre, and aim at it.
_SEEN = """
    const int count = lines.shape[1];
    const float* row = lines.data;
    const float* column = row + count;
    const float* down = column + count;
    const float* along = down + count;
    // Points stand in the order of their pixels: their rows rise, but for half a pixel.
    const auto before = [&](float y) {
        int low = 0, high = count;
        while (low < high) {
            const int middle = (low + high) / 2;
            if (row[middle] < y) low = middle + 1;
            else high = middle;
        }
        return low;
    };
    const int stop = before(cy + most + 1.0f);
    for (int begin = before(cy - most - 1.0f); begin < stop; begin += 64) {
        const int n = stop - begin < 64 ? stop - begin : 64;
        unsigned char seen[64];
        float far[64];
        int some = 0;
        #pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < n; ++k) {
            const float dy = row[begin + k] - cy, dx = column[begin + k] - cx;
            const float d = wp::sqrt(dy * dy + dx * dx);
            const float aside = dy * along[begin + k] - dx * down[begin + k];
            const float ahead = dy * down[begin + k] + dx * along[begin + k];
            const bool turned = ((ahead < 0.0f) & (first_side > 0)) |
                                ((ahead > 0.0f) & (last_side < 0));
            const bool near = (d >= least) & (d <= most);
            seen[k] = near & turned & (__builtin_fabsf(aside) <= slack + slope * d);
            far[k] = d;
            some |= seen[k];
        }
        if (!some) continue;
        for (int k = 0; k < n; ++k) {
            if (!seen[k]) continue;
            const float d = far[k];
            COUNT
        }
    }
"""


@wp.func_native(
    """
    #pragma clang fp contract(off)
    const float cy = centers.data[2 * i], cx = centers.data[2 * i + 1];
    const int bins = histograms.shape[1];
    int* out = histograms.data + (size_t)i * bins;
    for (int b = 0; b < bins; ++b) out[b] = 0;
    """
    + _SEEN.replace(
        "COUNT",
        """
            const int b = (int)((d - least) * per_bin);
            if (b < bins) ++out[b];
        """,
    )
)
def vote_radii_of(
    i: int,
    lines: wp.array2d[float],
    centers: wp.array2d[float],
    least: float,
    most: float,
    per_bin: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    histograms: wp.array2d[int],
): ...


@wp.kernel
def vote_radii(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    centers: wp.array2d[float],  # (K, 2)
    least: float,
    most: float,
    per_bin: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    # outputs
    histograms: wp.array2d[int],  # (K, bins)
):
    for i in range(first, last):
        vote_radii_of(
            i, lines, centers, least, most, per_bin, slack, slope, first_side, last_side,
            histograms,
        )  # fmt: skip


@wp.func_native(
    f"""
    #pragma clang fp contract(off)
    const float cy = circles.data[3 * i], cx = circles.data[3 * i + 1];
    const float radius = circles.data[3 * i + 2];
    const float least = radius - band, most = radius + band;
    long long* sum = (long long*)(sums.data + (size_t)i * 9);
    int* arc = arcs.data + (size_t)i * {ARCS};
    for (int k = 0; k < 9; ++k) sum[k] = 0;
    for (int k = 0; k < {ARCS}; ++k) arc[k] = 0;
    """
    + _SEEN.replace(
        "COUNT",
        f"""
            if (d <= 0.0f) continue;
            const float dy = row[begin + k] - cy, dx = column[begin + k] - cx;
            const long long ny = (long long)__builtin_floorf(dy / d * {NORMAL_ONE}.0f + 0.5f);
            const long long nx = (long long)__builtin_floorf(dx / d * {NORMAL_ONE}.0f + 0.5f);
            const long long e = (long long)__builtin_floorf((d - radius) * {FINE_ONE}.0f + 0.5f);
            sum[0] += ny * ny; sum[1] += ny * nx; sum[2] += nx * nx;
            sum[3] += ny; sum[4] += nx; sum[5] += 1;
            sum[6] += e * ny; sum[7] += e * nx; sum[8] += e;
            const float ay = __builtin_fabsf(dy), ax = __builtin_fabsf(dx);
            const bool steep = ay > ax;
            const int step = (int)((steep ? ax / ay : ay / ax) * {ARCS // 8}.0f);
            const int octant = (dy < 0.0f) | (dx < 0.0f) << 1 | steep << 2;
            ++arc[octant * {ARCS // 8} + (step < {ARCS // 8} ? step : {ARCS // 8 - 1})];
        """,
    )
)
def support_of(
    i: int,
    lines: wp.array2d[float],
    circles: wp.array2d[float],
    band: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    sums: wp.array2d[wp.int64],
    arcs: wp.array2d[int],
): ...


@wp.kernel
def support(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    circles: wp.array2d[float],  # (K, 3)
    band: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    # outputs
    sums: wp.array2d[wp.int64],  # (K, 9)
    arcs: wp.array2d[int],  # (K, ARCS)
):
    for i in range(first, last):
        support_of(i, lines, circles, band, slack, slope, first_side, last_side, sums, arcs)
