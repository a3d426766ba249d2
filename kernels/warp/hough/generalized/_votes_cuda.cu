// needs BLOCK WORDS DIRECTIONS TURNED_BITS SCALED_BITS TILE PEAKS
// A block has a slice, or a rectangle of it, of `deep` by `wide` cells, which are multiples of
// TILE. A word of shared memory holds two cells. One more row and column are counted, because the
// sums of the last cells need them; another column makes each row begin with a word. A warp takes
// 32 entries, one per lane, and finds their windows. It goes through the windows one by one, one
// lane per point. Then it takes tiles, one lane per word of two cells, or writes all votes.
void search(Ballot ballot, int deep, int wide, wp::array_t<int> found) {
    __shared__ unsigned int cell[WORDS];
    const int height = ballot.height, width = ballot.width, shift = ballot.shift;
    const int rows = ((height - 1) >> shift) + 1, columns = ((width - 1) >> shift) + 1;
    const int abreast = (columns + wide - 1) / wide;
    const int rectangles = (rows + deep - 1) / deep * abreast;
    const int slice = blockIdx.x / rectangles, rectangle = blockIdx.x % rectangles;
    const int top = rectangle / abreast * deep, left = rectangle % abreast * wide;
    const int pitch = wide + 2, lane = threadIdx.x % 32;
    for (int i = threadIdx.x; i < (deep + 1) * pitch / 2; i += BLOCK) cell[i] = 0;
    __syncthreads();
    const int scales = ballot.scales.shape[0], tolerance = ballot.tolerance;
    const int* turn = ballot.turns.data + 3 * (slice / scales);
    const int* starts = ballot.starts.data;
    const int scale = ballot.scales.data[slice % scales], angle = turn[0] - tolerance;
    const long long cosine = turn[1], sine = turn[2];
    const int count = ballot.directions.shape[0];
    const int y0 = top << shift, x0 = left << shift;
    const unsigned int tall = min(height, (top + deep + 1) << shift) - y0;
    const unsigned int broad = min(width, (left + wide + 1) << shift) - x0;
    const int *ys = ballot.points.data, *xs = ys + ballot.points.shape[1];
    for (int base = threadIdx.x / 32 * 32; base < count; base += BLOCK) {
        const int entry = base + lane;
        int first = 0, last = 0, down = 0, along = 0;
        if (entry < count) {
            const int low = (ballot.directions.data[entry] + angle) & (DIRECTIONS - 1);
            const long long y = ballot.vectors.data[2 * entry];
            const long long x = ballot.vectors.data[2 * entry + 1];
            const long long half = 1 << (TURNED_BITS - 1);
            first = starts[low];
            last = starts[low + 2 * tolerance + 1];
            down = (int)((y * cosine + x * sine + half) >> TURNED_BITS);
            along = (int)((x * cosine - y * sine + half) >> TURNED_BITS);
            down = ((down * scale + (1 << (SCALED_BITS - 1))) >> SCALED_BITS) - y0;
            along = ((along * scale + (1 << (SCALED_BITS - 1))) >> SCALED_BITS) - x0;
        }
        const int taken = min(32, count - base);
        for (int e = 0; e < taken; ++e) {
            const int end = __shfl_sync(0xffffffffu, last, e);
            const int dy = __shfl_sync(0xffffffffu, down, e);
            const int dx = __shfl_sync(0xffffffffu, along, e);
            for (int i = __shfl_sync(0xffffffffu, first, e) + lane; i < end; i += 32) {
                const int y = ys[i] + dy, x = xs[i] + dx;
                if ((unsigned int)y < tall && (unsigned int)x < broad) {
                    const int place = (y >> shift) * pitch + (x >> shift);
                    atomicAdd(cell + (place >> 1), 1u << 16 * (place & 1));
                }
            }
        }
    }
    __syncthreads();
    if (!PEAKS) {
        for (int i = threadIdx.x; i < deep * wide; i += BLOCK) {
            const int row = i / wide, column = i % wide, place = row * pitch + column;
            if (top + row < rows && left + column < columns)
                found.data[((size_t)slice * rows + top + row) * columns + left + column] =
                    cell[place >> 1] >> 16 * (place & 1) & 0xffff;
        }
        return;
    }
    const int across = (columns + TILE - 1) / TILE, below = (rows + TILE - 1) / TILE;
    const int line = lane / (TILE / 2), word = lane % (TILE / 2);
    const int place = TILE * TILE - 1 - (line * TILE + 2 * word);
    int row = 0, column = threadIdx.x / 32;  // the tile in the rectangle
    for (;; column += BLOCK / 32) {
        for (; column >= wide / TILE; column -= wide / TILE) ++row;
        const int tile_row = top / TILE + row, tile_column = left / TILE + column;
        if (row >= deep / TILE || tile_row >= below) break;
        if (tile_column >= across) continue;
        // The sums need the words to the right and below.
        const unsigned int* here = cell + ((row * TILE + line) * pitch + column * TILE) / 2 + word;
        const unsigned int* under = here + pitch / 2;
        const int first = (here[0] & 0xffff) + (under[0] & 0xffff);
        const int second = (here[0] >> 16) + (under[0] >> 16);
        const int third = (here[1] & 0xffff) + (under[1] & 0xffff);
        const int y = tile_row * TILE + line, x = tile_column * TILE + 2 * word;
        int best = 0;
        if (y < rows && x < columns) best = (first + second) * (TILE * TILE) + place;
        if (y < rows && x + 1 < columns)
            best = max(best, (second + third) * (TILE * TILE) + place - 1);
#if __CUDA_ARCH__ >= 800
        best = __reduce_max_sync(0xffffffffu, best);
#else
        for (int step = 16; step; step /= 2)
            best = max(best, __shfl_xor_sync(0xffffffffu, best, step));
#endif
        if (lane == 0) found.data[((size_t)slice * below + tile_row) * across + tile_column] = best;
    }
}
