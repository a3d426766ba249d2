// needs LANES SCALED_BITS
// Vote for one slice, into the slab's cells. Cells after the last column and the last row stay 0.
// After them, LANES cells take the votes that fall outside, one cell per lane, because votes for
// one cell would wait for each other. Vector code lists the cells of the votes of LANES points.
void vote_slice(int slab, int scale, Ballot ballot, wp::array_t<int> windows,
                wp::array_t<wp::uint16> cells) {
    const int shift = ballot.shift, rows = ((ballot.height - 1) >> shift) + 1;
    const int pitch = ((ballot.width - 1) >> shift) + 2;
    const int outside = (rows + 1) * pitch, count = ballot.directions.shape[0];
    const unsigned tall = ballot.height, broad = ballot.width;
    const int *ys = ballot.points.data, *xs = ys + ballot.points.shape[1];
    unsigned short* cell = cells.data + (size_t)slab * cells.shape[1];
    for (int i = 0; i < outside + LANES; ++i) cell[i] = 0;
    int list[1024 + LANES];
    int listed = 0;
    for (int e = 0; e < count; ++e) {
        const int* window = windows.data + 4 * ((size_t)slab * count + e);
        const int dy = (window[2] * scale + (1 << (SCALED_BITS - 1))) >> SCALED_BITS;
        const int dx = (window[3] * scale + (1 << (SCALED_BITS - 1))) >> SCALED_BITS;
        const int last = window[1];
        for (int i = window[0]; i < last; i += LANES) {
            int* place = list + listed;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const int y = ys[i + k] + dy, x = xs[i + k] + dx;
                const bool inside = ((unsigned)y < tall) & ((unsigned)x < broad);
                place[k] = inside ? (y >> shift) * pitch + (x >> shift) : outside + k;
            }
            listed += last - i < LANES ? last - i : LANES;
            if (listed > 1024) {
#pragma clang loop unroll_count(4)
                for (int k = 0; k < listed; ++k) ++cell[list[k]];
                listed = 0;
            }
        }
    }
    for (int k = 0; k < listed; ++k) ++cell[list[k]];
}

// needs TILE
// Add the four cells that meet at each corner, so that a peak between cells is not lost. The key of
// a tile is its largest sum, with the place of the first corner that has it in the lower bits.
void find_peaks(int slab, int slice, Ballot ballot, wp::array_t<wp::uint16> cells,
                wp::array_t<int> keys) {
    const int rows = ((ballot.height - 1) >> ballot.shift) + 1;
    const int columns = ((ballot.width - 1) >> ballot.shift) + 1, pitch = columns + 1;
    const int across = (columns + TILE - 1) / TILE, down = (rows + TILE - 1) / TILE;
    const unsigned short* cell = cells.data + (size_t)slab * cells.shape[1];
    int* key = keys.data + (size_t)slice * down * across;
    for (int tile = 0; tile < down; ++tile) {
        const int first = tile * TILE, last = first + TILE < rows ? first + TILE : rows;
        for (int begin = 0; begin < columns; begin += 256) {
            int best[256];
            const int count = columns - begin < 256 ? columns - begin : 256;
            for (int k = 0; k < 256; ++k) best[k] = 0;
            for (int row = first; row < last; ++row) {
                const unsigned short* above = cell + (size_t)row * pitch + begin;
                const unsigned short* below = above + pitch;
                const int place = TILE * TILE - 1 - (row - first) * TILE;
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < count; ++k) {
                    const int sum = above[k] + above[k + 1] + below[k] + below[k + 1];
                    const int here = sum * (TILE * TILE) + place - (k & (TILE - 1));
                    best[k] = here > best[k] ? here : best[k];
                }
            }
            for (int k = 0; k < count; k += TILE) {
                int most = best[k];
                for (int i = 1; i < TILE; ++i) most = best[k + i] > most ? best[k + i] : most;
                key[tile * across + (begin + k) / TILE] = most;
            }
        }
    }
}
