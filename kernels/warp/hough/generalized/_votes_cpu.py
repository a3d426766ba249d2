"""The generalised Hough transform on the CPU: one thread a slab of slices, a slice at a time.

The accumulator of a slice, one rotation and one scale, stays in the cache. Where the votes of 16
points fall is worked out in vector code, into a list; what is left is adding one at each place.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, SCALE_ONE, TILE, TURN_ONE, TURNED_ONE, VECTOR_ONE

wp.set_module_options({"enable_backward": False})

LANES = 16  # points are read this many at a time, beyond the end of a window too
_DOWN = TURN_ONE * VECTOR_ONE // TURNED_ONE
_ONE = TURNED_ONE * SCALE_ONE


@wp.func_native(f"""
    // For each entry: the points whose direction is within the tolerance, and its turned vector.
    const int* turn = turns.data + 3 * rotation;
    for (int e = 0; e < directions.shape[0]; ++e) {{
        const int low = (directions.data[e] + turn[0] - tolerance) & {DIRECTIONS - 1};
        const long long y = vectors.data[2 * e], x = vectors.data[2 * e + 1];
        int* window = windows.data + 4 * ((size_t)slab * directions.shape[0] + e);
        window[0] = starts.data[low];
        window[1] = starts.data[low + 2 * tolerance + 1];
        window[2] = (int)((y * turn[1] + x * turn[2] + {_DOWN // 2}) >> {_DOWN.bit_length() - 1});
        window[3] = (int)((x * turn[1] - y * turn[2] + {_DOWN // 2}) >> {_DOWN.bit_length() - 1});
    }}
""")
def turn_entries(
    slab: int,
    rotation: int,
    starts: wp.array[int],
    vectors: wp.array2d[int],
    directions: wp.array[int],
    turns: wp.array2d[int],
    tolerance: int,
    windows: wp.array2d[int],
): ...


# Cells beyond the last column and the last row stay 0; 16 behind them take the votes that fall
# outside, one each, as a cell that all of them hit would make them wait for each other.
@wp.func_native(f"""
    const int rows = ((height - 1) >> shift) + 1, pitch = ((width - 1) >> shift) + 2;
    const int outside = (rows + 1) * pitch, count = windows.shape[0] / slabs;
    const unsigned tall = height, broad = width;
    const int* ys = points.data;
    const int* xs = points.data + points.shape[1];
    unsigned short* cell = cells.data + (size_t)slab * cells.shape[1];
    for (int i = 0; i < outside + {LANES}; ++i) cell[i] = 0;
    int list[1024 + {LANES}];
    int listed = 0;
    for (int e = 0; e < count; ++e) {{
        const int* window = windows.data + 4 * ((size_t)slab * count + e);
        const int dy = (window[2] * scale + {_ONE // 2}) >> {_ONE.bit_length() - 1};
        const int dx = (window[3] * scale + {_ONE // 2}) >> {_ONE.bit_length() - 1};
        const int last = window[1];
        for (int i = window[0]; i < last; i += {LANES}) {{
            int* place = list + listed;
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < {LANES}; ++k) {{
                const int y = ys[i + k] + dy, x = xs[i + k] + dx;
                const bool inside = ((unsigned)y < tall) & ((unsigned)x < broad);
                place[k] = inside ? (y >> shift) * pitch + (x >> shift) : outside + k;
            }}
            listed += last - i < {LANES} ? last - i : {LANES};
            if (listed > 1024) {{
                #pragma clang loop unroll_count(4)
                for (int k = 0; k < listed; ++k) ++cell[list[k]];
                listed = 0;
            }}
        }}
    }}
    for (int k = 0; k < listed; ++k) ++cell[list[k]];
""")
def vote_slice(
    slab: int,
    slabs: int,
    points: wp.array2d[int],
    windows: wp.array2d[int],
    scale: int,
    height: int,
    width: int,
    shift: int,
    cells: wp.array2d[wp.uint16],
): ...


# Of four cells that meet at a corner the sum, or a peak between cells would be lost; then of each
# tile the largest, and of equal ones the first, which the lower bits of the key say.
@wp.func_native(f"""
    const int rows = ((height - 1) >> shift) + 1, pitch = ((width - 1) >> shift) + 2;
    const int across = (pitch - 1 + {TILE - 1}) / {TILE}, down = (rows + {TILE - 1}) / {TILE};
    const unsigned short* cell = cells.data + (size_t)slab * cells.shape[1];
    int* key = keys.data + (size_t)slice * down * across;
    for (int tile = 0; tile < down; ++tile) {{
        const int first = tile * {TILE}, last = first + {TILE} < rows ? first + {TILE} : rows;
        for (int begin = 0; begin < pitch - 1; begin += 256) {{
            int best[256];
            const int columns = pitch - 1 - begin < 256 ? pitch - 1 - begin : 256;
            for (int k = 0; k < 256; ++k) best[k] = 0;
            for (int row = first; row < last; ++row) {{
                const unsigned short* above = cell + (size_t)row * pitch + begin;
                const unsigned short* below = above + pitch;
                const int place = {TILE * TILE - 1} - (row - first) * {TILE};
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < columns; ++k) {{
                    const int sum = above[k] + above[k + 1] + below[k] + below[k + 1];
                    const int here = sum * {TILE * TILE} + place - (k & {TILE - 1});
                    best[k] = here > best[k] ? here : best[k];
                }}
            }}
            for (int k = 0; k < columns; k += {TILE}) {{
                int most = best[k];
                for (int i = 1; i < {TILE}; ++i) most = best[k + i] > most ? best[k + i] : most;
                key[tile * across + (begin + k) / {TILE}] = most;
            }}
        }}
    }}
""")
def find_peaks(
    slab: int,
    slice: int,
    cells: wp.array2d[wp.uint16],
    height: int,
    width: int,
    shift: int,
    keys: wp.array[int],
): ...


@wp.func_native("""
    const int rows = ((height - 1) >> shift) + 1, columns = ((width - 1) >> shift) + 1;
    const unsigned short* cell = cells.data + (size_t)slab * cells.shape[1];
    int* vote = votes.data + (size_t)slice * rows * columns;
    for (int row = 0; row < rows; ++row)
        for (int k = 0; k < columns; ++k)
            vote[(size_t)row * columns + k] = cell[(size_t)row * (columns + 1) + k];
""")
def copy_votes(
    slab: int,
    slice: int,
    cells: wp.array2d[wp.uint16],
    height: int,
    width: int,
    shift: int,
    votes: wp.array[int],
): ...


@wp.kernel
def search(
    slab: int,
    first: int,
    last: int,
    slabs: int,
    points: wp.array2d[int],  # (2, P + LANES): rows, columns
    starts: wp.array[int],  # (2 DIRECTIONS + 1,)
    vectors: wp.array2d[int],  # (N, 2)
    directions: wp.array[int],  # (N,)
    turns: wp.array2d[int],  # (R, 3)
    scales: wp.array[int],  # (S,)
    tolerance: int,
    height: int,
    width: int,
    shift: int,
    peaks: bool,
    # scratch
    windows: wp.array2d[int],  # (slabs N, 4)
    cells: wp.array2d[wp.uint16],  # (slabs, cells of a slice with margin)
    # outputs
    found: wp.array[int],  # keys of the tiles, or votes of the cells, of the R S slices
):
    count = scales.shape[0]
    for slice in range(first, last):
        rotation = slice // count
        if slice == first or slice % count == 0:
            turn_entries(slab, rotation, starts, vectors, directions, turns, tolerance, windows)
        scale = scales[slice % count]
        vote_slice(slab, slabs, points, windows, scale, height, width, shift, cells)
        if peaks:
            find_peaks(slab, slice, cells, height, width, shift, found)
        else:
            copy_votes(slab, slice, cells, height, width, shift, found)
