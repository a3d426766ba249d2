"""Votes for lines on the CPU: one thread a slab of angles, each with histograms of its own.

Bins of 64 points are computed as vector code, for eight angles at a time: votes of one angle often
fall into one bin in a row, and would wait for each other.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ANGLES = 8  # at a time
GROUP = 16  # angles whose histograms are written together, a cache line a bin
_POINTS = 64  # at a time

# `at` has the bins of the points from `begin` on: rho in fixed point, (x C + y S + O) >> shift.
_BINS = """
    for (int k = 0; k < ANGLES; ++k) {
        const long long c = cosine.data[angle + k], s = sine.data[angle + k];
        const long long o = offset.data[angle + k];
        #pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < COUNT; ++i) {
            const long long pair = pairs[begin + i];  // the row is the lower half
            at[k][i] = (unsigned long long)((pair >> 32) * c + (int)pair * s + o) >> shift;
        }
    }
    for (int i = 0; i < COUNT; ++i) { VOTES }
"""


def _text(vote: str) -> str:
    votes = " ".join(f"h[{k} * pitch + at[{k}][i]] += {vote};" for k in range(ANGLES))
    bins = _BINS.replace("VOTES", votes).replace("ANGLES", str(ANGLES))
    return f"""
    const long long* pairs = (const long long*)points.data;
    const size_t pitch = lines.shape[1];
    int* h = lines.data + line * pitch;
    int at[{ANGLES}][{_POINTS}];
    int begin = 0;
    for (; begin + {_POINTS} <= number; begin += {_POINTS}) {{ {bins.replace("COUNT", str(_POINTS))} }}
    const int rest = number - begin;
    {bins.replace("COUNT", "rest")}
    """  # noqa: E501


@wp.func_native(_text("1"))
def vote_for_eight(
    points: wp.array2d[int],
    number: int,
    cosine: wp.array[int],
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    angle: int,
    line: int,
    lines: wp.array2d[int],
): ...


@wp.func_native(_text("weights.data[begin + i]"))
def vote_for_eight_weighted(
    points: wp.array2d[int],
    number: int,
    cosine: wp.array[int],
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weights: wp.array[int],
    angle: int,
    line: int,
    lines: wp.array2d[int],
): ...


@wp.func_native("""
    const size_t pitch = lines.shape[1];
    int* h = lines.data + line * pitch;
    for (size_t i = 0; i < count * pitch; ++i) h[i] = 0;
""")
def clear(line: int, count: int, lines: wp.array2d[int]): ...


@wp.func_native("""
    const size_t pitch = lines.shape[1], angles = votes.shape[1];
    const int* h = lines.data + line * pitch;
    for (size_t bin = 0; bin < pitch; ++bin) {
        int* to = votes.data + bin * angles + angle;
        for (int k = 0; k < count; ++k) to[k] = h[k * pitch + bin];
    }
""")
def write(line: int, angle: int, count: int, lines: wp.array2d[int], votes: wp.array2d[int]): ...


@wp.kernel
def vote(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],  # its last element is the number of points
    cosine: wp.array[int],  # (T + up to 7,)
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weighted: bool,
    weights: wp.array[int],  # (capacity,)
    # scratch
    lines: wp.array2d[int],  # (slabs GROUP, R)
    # outputs
    votes: wp.array2d[int],  # (R, T)
):
    # Rows of a slab are groups of eight angles.
    number = starts[starts.shape[0] - 1]
    line = slab * wp.static(GROUP)
    angle = first * wp.static(ANGLES)
    while angle < last * wp.static(ANGLES):
        count = wp.min(wp.static(GROUP), last * wp.static(ANGLES) - angle)
        clear(line, count, lines)
        for k in range(0, count, wp.static(ANGLES)):
            if weighted:
                vote_for_eight_weighted(
                    points, number, cosine, sine, offset, shift, weights, angle + k, line + k,
                    lines,
                )  # fmt: skip
            else:
                vote_for_eight(
                    points, number, cosine, sine, offset, shift, angle + k, line + k, lines
                )
        write(line, angle, wp.min(count, votes.shape[1] - angle), lines, votes)
        angle += count


# With a direction a point has few votes: they go where they belong, in slabs of angles.


@wp.func_native("""
    const size_t angles = votes.shape[1];
    for (size_t bin = 0; bin < votes.shape[0]; ++bin)
        for (int angle = first; angle < last; ++angle) votes.data[bin * angles + angle] = 0;
    for (int i = 0; i < number; ++i) {
        const int begin = windows.data[2 * i], end = begin + windows.data[2 * i + 1];
        const long long y = points.data[2 * i], x = points.data[2 * i + 1];
        const int vote = weighted ? weights.data[i] : 1;
        for (int turn = 0; turn <= (end > angles); ++turn) {  // the window goes on from angle 0
            const int base = turn * (int)angles;
            const int from = begin - base > first ? begin - base : first;
            const int to = end - base < last ? end - base : last;
            for (int angle = from; angle < to; ++angle) {
                const long long rho = x * cosine.data[angle] + y * sine.data[angle];
                votes.data[((rho + offset.data[angle]) >> shift) * angles + angle] += vote;
            }
        }
    }
""")
def vote_in_windows(
    first: int,
    last: int,
    points: wp.array2d[int],
    number: int,
    windows: wp.array2d[int],
    cosine: wp.array[int],
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weighted: bool,
    weights: wp.array[int],
    votes: wp.array2d[int],
): ...


@wp.kernel
def vote_directed(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],
    windows: wp.array2d[int],  # (capacity, 2)
    cosine: wp.array[int],  # (T + up to 7,)
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weighted: bool,
    weights: wp.array[int],  # (capacity,)
    # outputs
    votes: wp.array2d[int],  # (R, T)
):
    # Rows of a slab are angles.
    number = starts[starts.shape[0] - 1]
    vote_in_windows(
        first, last, points, number, windows, cosine, sine, offset, shift, weighted, weights, votes
    )
