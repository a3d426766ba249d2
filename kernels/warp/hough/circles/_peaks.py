"""Peaks among votes, one row after the other: a slab of rows a thread on the CPU, one on CUDA."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func_native("""
    const int width = votes.shape[2];
    const float* v = votes.data + (size_t)row * width;
    float lanes[16];
    for (int k = 0; k < 16; ++k) lanes[k] = v[0];
    int x = 0;
    for (; x + 16 <= width; x += 16)
        for (int k = 0; k < 16; ++k) lanes[k] = v[x + k] > lanes[k] ? v[x + k] : lanes[k];
    for (; x < width; ++x) lanes[0] = v[x] > lanes[0] ? v[x] : lanes[0];
    for (int k = 1; k < 16; ++k) lanes[0] = lanes[k] > lanes[0] ? lanes[k] : lanes[0];
    tops.data[row] = lanes[0];
""")
def top_of_row(votes: wp.array3d[float], row: int, tops: wp.array[float]): ...


# A peak is above the limit, at least all within `down` rows and `along` columns, and above those
# of them that come before it.
_PEAKS = """
    const int width = votes.shape[2], height = votes.shape[1], plane = row / height;
    BEGIN
    const float* v = votes.data + (size_t)row * width;
    const float limit = limits.data[plane];
    const int top = row - down < plane * height ? plane * height : row - down;
    const int bottom = row + down >= (plane + 1) * height ? (plane + 1) * height - 1 : row + down;
    const float* above = row > plane * height ? v - width : v;
    const float* below = row + 1 < (plane + 1) * height ? v + width : v;
    int n = FIRST;
    for (int begin = 0; begin < width; begin += 64) {
        const int end = begin + 64 < width ? begin + 64 : width;
        unsigned char large[64];
        int some = 0;
        // Few are as large as the four next to them: only those are looked at closer.
        #pragma clang loop vectorize(assume_safety)
        for (int x = begin; x < end; ++x)
            some |= large[x - begin] = (v[x] > limit) & (v[x] >= above[x]) & (v[x] >= below[x]);
        if (!some) continue;
        some = 0;
        const int inner = end < width ? end : width - 1;
        #pragma clang loop vectorize(assume_safety)
        for (int x = begin ? begin : 1; x < inner; ++x)
            large[x - begin] &= (v[x] >= v[x - 1]) & (v[x] >= v[x + 1]);
        for (int x = begin; x < end; ++x) some |= large[x - begin];
        if (!some) continue;
        for (int x = begin; x < end; ++x) {
            if (!large[x - begin]) continue;
            const int left = x - along < 0 ? 0 : x - along;
            const int right = x + along >= width ? width - 1 : x + along;
            bool peak = true;
            for (int r = top; peak && r <= bottom; ++r) {
                const float* u = votes.data + (size_t)r * width;
                for (int c = left; peak && c <= right; ++c)
                    peak = u[c] < v[x] || (u[c] == v[x] && (r > row || (r == row && c >= x)));
            }
            if (!peak) continue;
            FOUND
            ++n;
        }
    }
    LAST
"""


@wp.func_native(
    _PEAKS.replace("BEGIN", "")
    .replace("FIRST", "0")
    .replace("FOUND", "")
    .replace("LAST", "counts.data[row] = n;")
)
def count_in_row(
    votes: wp.array3d[float],
    row: int,
    limits: wp.array[float],
    down: int,
    along: int,
    counts: wp.array[int],
): ...


@wp.func_native(
    _PEAKS.replace("BEGIN", "if (starts.data[row] == starts.data[row + 1]) return;")
    .replace("FIRST", "starts.data[row]")
    .replace(
        "FOUND",
        "values.data[n] = v[x]; places.data[3 * n] = plane; "
        "places.data[3 * n + 1] = row - plane * height; places.data[3 * n + 2] = x;",
    )
    .replace("LAST", "")
)
def gather_in_row(
    votes: wp.array3d[float],
    row: int,
    limits: wp.array[float],
    down: int,
    along: int,
    starts: wp.array[int],
    places: wp.array2d[int],
    values: wp.array[float],
): ...


@wp.kernel
def row_maxima(
    slab: int,
    first: int,
    last: int,
    votes: wp.array3d[float],  # (P, H, W)
    # outputs
    tops: wp.array[float],  # (P H,)
):
    for row in range(first, last):
        top_of_row(votes, row, tops)


@wp.kernel
def count_peaks(
    slab: int,
    first: int,
    last: int,
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    # outputs
    counts: wp.array[int],  # (P H,)
):
    for row in range(first, last):
        count_in_row(votes, row, limits, down, along, counts)


@wp.kernel
def gather_peaks(
    slab: int,
    first: int,
    last: int,
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    starts: wp.array[int],  # (P H + 1,)
    # outputs
    places: wp.array2d[int],  # (N, 3)
    values: wp.array[float],  # (N,)
):
    for row in range(first, last):
        gather_in_row(votes, row, limits, down, along, starts, places, values)


@wp.kernel
def row_maximum(
    votes: wp.array3d[float],
    # outputs
    tops: wp.array[float],
):
    top_of_row(votes, wp.tid(), tops)


@wp.kernel
def count_row(
    votes: wp.array3d[float],
    limits: wp.array[float],
    down: int,
    along: int,
    # outputs
    counts: wp.array[int],
):
    count_in_row(votes, wp.tid(), limits, down, along, counts)


@wp.kernel
def gather_row(
    votes: wp.array3d[float],
    limits: wp.array[float],
    down: int,
    along: int,
    starts: wp.array[int],
    # outputs
    places: wp.array2d[int],
    values: wp.array[float],
):
    gather_in_row(votes, wp.tid(), limits, down, along, starts, places, values)
