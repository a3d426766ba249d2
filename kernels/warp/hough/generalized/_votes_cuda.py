"""The generalised Hough transform on CUDA: a block has a slice, or a rectangle of it, to itself.

Its accumulator is in shared memory, two cells a word. A warp takes 32 entries, one a lane, finds
their windows, and goes through them one by one, a point a lane. Peaks are found before anything is
written out.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, SCALE_ONE, TILE, TURN_ONE, TURNED_ONE, VECTOR_ONE

wp.set_module_options({"enable_backward": False})

BLOCK = 256  # threads; Warp's own
WORDS = 11904  # of shared memory: with Warp's own 1 KB below the 48 KB that a block may have
CELLS = 2 * WORDS
assert TILE * TILE == 2 * 32, "a lane takes two cells of a tile"
_DOWN = TURN_ONE * VECTOR_ONE // TURNED_ONE
_ONE = TURNED_ONE * SCALE_ONE

# A rectangle is deep by wide cells, multiples of TILE; a row and a column more are counted, as the
# sums of its last cells reach there. Another column makes each row begin with a word.
_VOTE = f"""
    __shared__ unsigned int cell[{WORDS}];
    const int rows = ((height - 1) >> shift) + 1, columns = ((width - 1) >> shift) + 1;
    const int abreast = (columns + wide - 1) / wide;
    const int rectangles = (rows + deep - 1) / deep * abreast;
    const int slice = blockIdx.x / rectangles, rectangle = blockIdx.x % rectangles;
    const int top = rectangle / abreast * deep, left = rectangle % abreast * wide;
    const int pitch = wide + 2, lane = threadIdx.x % 32;
    for (int i = threadIdx.x; i < (deep + 1) * pitch / 2; i += {BLOCK}) cell[i] = 0;
    __syncthreads();
    const int* turn = turns.data + 3 * (slice / scales.shape[0]);
    const int scale = scales.data[slice % scales.shape[0]];
    const int angle = turn[0] - tolerance;
    const long long cosine = turn[1], sine = turn[2];
    const int count = directions.shape[0];
    const int y0 = top << shift, x0 = left << shift;
    const unsigned int tall = min(height, (top + deep + 1) << shift) - y0;
    const unsigned int broad = min(width, (left + wide + 1) << shift) - x0;
    const int* ys = points.data;
    const int* xs = points.data + points.shape[1];
    for (int base = threadIdx.x / 32 * 32; base < count; base += {BLOCK}) {{
        const int entry = base + lane;
        int first = 0, last = 0, down = 0, along = 0;
        if (entry < count) {{
            const int low = (directions.data[entry] + angle) & {DIRECTIONS - 1};
            const long long y = vectors.data[2 * entry], x = vectors.data[2 * entry + 1];
            first = starts.data[low];
            last = starts.data[low + 2 * tolerance + 1];
            down = (int)((y * cosine + x * sine + {_DOWN // 2}) >> {_DOWN.bit_length() - 1});
            along = (int)((x * cosine - y * sine + {_DOWN // 2}) >> {_DOWN.bit_length() - 1});
            down = ((down * scale + {_ONE // 2}) >> {_ONE.bit_length() - 1}) - y0;
            along = ((along * scale + {_ONE // 2}) >> {_ONE.bit_length() - 1}) - x0;
        }}
        const int taken = min(32, count - base);
        for (int e = 0; e < taken; ++e) {{
            const int end = __shfl_sync(0xffffffffu, last, e);
            const int dy = __shfl_sync(0xffffffffu, down, e);
            const int dx = __shfl_sync(0xffffffffu, along, e);
            for (int i = __shfl_sync(0xffffffffu, first, e) + lane; i < end; i += 32) {{
                const int y = ys[i] + dy, x = xs[i] + dx;
                if ((unsigned int)y < tall && (unsigned int)x < broad) {{
                    const int place = (y >> shift) * pitch + (x >> shift);
                    atomicAdd(cell + (place >> 1), 1u << 16 * (place & 1));
                }}
            }}
        }}
    }}
    __syncthreads();
"""

# A warp takes a tile, a lane the two cells of a word; the sums need the words beside and below.
_PEAKS = f"""
    const int across = (columns + {TILE - 1}) / {TILE}, below = (rows + {TILE - 1}) / {TILE};
    const int line = lane / {TILE // 2}, word = lane % {TILE // 2};
    const int place = {TILE * TILE - 1} - (line * {TILE} + 2 * word);
    int row = 0, column = threadIdx.x / 32;  // of tiles, in the rectangle
    for (;; column += {BLOCK // 32}) {{
        for (; column >= wide / {TILE}; column -= wide / {TILE}) ++row;
        const int tile_row = top / {TILE} + row, tile_column = left / {TILE} + column;
        if (row >= deep / {TILE} || tile_row >= below) break;
        if (tile_column >= across) continue;
        const unsigned int* here
            = cell + ((row * {TILE} + line) * pitch + column * {TILE}) / 2 + word;
        const unsigned int* under = here + pitch / 2;
        const int first = (here[0] & 0xffff) + (under[0] & 0xffff);
        const int second = (here[0] >> 16) + (under[0] >> 16);
        const int third = (here[1] & 0xffff) + (under[1] & 0xffff);
        const int y = tile_row * {TILE} + line, x = tile_column * {TILE} + 2 * word;
        int best = 0;
        if (y < rows && x < columns) best = (first + second) * {TILE * TILE} + place;
        if (y < rows && x + 1 < columns)
            best = max(best, (second + third) * {TILE * TILE} + place - 1);
        #if __CUDA_ARCH__ >= 800
        best = __reduce_max_sync(0xffffffffu, best);
        #else
        for (int step = 16; step; step /= 2)
            best = max(best, __shfl_xor_sync(0xffffffffu, best, step));
        #endif
        if (lane == 0) found.data[((size_t)slice * below + tile_row) * across + tile_column] = best;
    }}
"""

_COPY = f"""
    for (int i = threadIdx.x; i < deep * wide; i += {BLOCK}) {{
        const int row = i / wide, column = i % wide, place = row * pitch + column;
        if (top + row < rows && left + column < columns)
            found.data[((size_t)slice * rows + top + row) * columns + left + column]
                = cell[place >> 1] >> 16 * (place & 1) & 0xffff;
    }}
"""


def rectangle(rows: int, columns: int) -> tuple[int, int, int]:
    """Return rows and columns of the fewest rectangles that hold a slice, and their number."""
    best = None
    for abreast in range(1, -(-columns // TILE) + 1):
        wide = -(-columns // (abreast * TILE)) * TILE
        deep = min(CELLS // (wide + 2) - 1, rows + TILE - 1) // TILE * TILE
        if deep > 0:
            number = -(-rows // deep) * -(-columns // wide)
            if best is None or number < best[2]:
                best = deep, wide, number
            elif wide < 64:  # narrower ones are no fewer
                break
    assert best is not None
    return best


def _kernel(text: str) -> wp.Kernel:
    """Return the kernel that votes, and then does what `text` says."""

    @wp.func_native(_VOTE + text)
    def vote(
        points: wp.array2d[int],
        starts: wp.array[int],
        vectors: wp.array2d[int],
        directions: wp.array[int],
        turns: wp.array2d[int],
        scales: wp.array[int],
        tolerance: int,
        height: int,
        width: int,
        shift: int,
        deep: int,
        wide: int,
        found: wp.array[int],
    ): ...

    @wp.kernel
    def search(
        points: wp.array2d[int],  # (2, P): rows, columns
        starts: wp.array[int],  # (2 DIRECTIONS + 1,)
        vectors: wp.array2d[int],  # (N, 2)
        directions: wp.array[int],  # (N,)
        turns: wp.array2d[int],  # (R, 3)
        scales: wp.array[int],  # (S,)
        tolerance: int,
        height: int,
        width: int,
        shift: int,
        deep: int,
        wide: int,
        # outputs
        found: wp.array[int],  # keys of the tiles, or votes of the cells, of the R S slices
    ):
        vote(
            points, starts, vectors, directions, turns, scales, tolerance, height, width, shift,
            deep, wide, found,
        )  # fmt: skip

    return search


search = _kernel(_PEAKS)
accumulate = _kernel(_COPY)
