// The pixels of a row that are on different sides of the medians of two images.

// needs MOVES
void _differ_row(int slot, int y, wp::array_t<uint8_t> sides, int k, int fixed, int dy, int dx,
                 wp::array_t<int> sums) {
    const int down[MOVES] = {0, -1, 0, 0, 1, -1, -1, 1, 1};
    const int along[MOVES] = {0, 0, -1, 1, 0, -1, 1, -1, 1};
    const int height = sides.shape[1], width = sides.shape[2];
    const unsigned char* there = sides.data + ((size_t)fixed * height + y) * width;
    for (int n = 0; n < MOVES; ++n) {
        const int v = y - dy - down[n], off = dx + along[n];
        if (v < 0 || v >= height) continue;
        const unsigned char* here = sides.data + ((size_t)k * height + v) * width;
        const int first = off > 0 ? off : 0, last = off < 0 ? width + off : width;
        int total = 0;
        for (int x = first; x < last; x += 128) {
            const int end = x + 128 < last ? x + 128 : last;
            unsigned char some = 0;  // at most 128: no overflow
            for (int i = x; i < end; ++i) some += (unsigned char)(here[i - off] + there[i] == 3);
            total += some;
        }
        sums.data[slot * MOVES + n] += total;
    }
}
