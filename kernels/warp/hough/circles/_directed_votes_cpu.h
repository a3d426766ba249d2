// needs DIRECTIONS DIRECTION_FACTOR
// The rows of a slab are rows of the accumulators, ring after ring. They are set to 0; then each
// point that is near enough casts its votes that fall into these rows. The rows of the points are
// `lift` larger than in their image.
void vote_directed(int slab, int first, int last, wp::array_t<int> points, wp::array_t<int> starts,
                   wp::array_t<float> orientation, wp::array_t<int> directions, int tolerance,
                   Circles rings, bool shares, int lift, wp::array_t<int> votes) {
#pragma clang fp contract(off)
    const int rows = votes.shape[1], columns = votes.shape[2];
    const int height = orientation.shape[0], width = orientation.shape[1];
    const int pad = (columns - width) / 2;
    const int *offsets = rings.offsets.data, *codes = rings.codes.data;
    for (int ring = first / rows; ring * rows < last; ++ring) {
        const int low_row = first > ring * rows ? first - ring * rows : 0;
        const int high_row = last - ring * rows < rows ? last - ring * rows : rows;
        int* out = votes.data + (size_t)ring * rows * columns;
        const size_t from = (size_t)low_row * columns, to = (size_t)high_row * columns;
        for (size_t i = from; i < to; ++i) out[i] = 0;
        const int radius = rings.radii.data[ring];
        const int begin = rings.starts.data[ring], end = rings.starts.data[ring + 1];
        const auto vote = [&](int y, int x) {
            if (y >= low_row && y < high_row && x >= 0 && x < columns)
                ++out[(size_t)y * columns + x];
        };
        const auto before = [&](int y) { return starts.data[y < 0 ? 0 : y > height ? height : y]; };
        const int stop = before(high_row - pad + radius);
        for (int i = before(low_row - pad - radius); i < stop; ++i) {
            const int y = points.data[2 * i] - lift, x = points.data[2 * i + 1];
            const float angle = orientation.data[(size_t)y * width + x];
            const int code =
                (int)__builtin_floorf(angle * (float)DIRECTION_FACTOR + 0.5f) & (DIRECTIONS - 1);
            if (tolerance < 0) {
                const int down = (radius * directions.data[2 * code] + 32768) >> 16;
                const int along = (radius * directions.data[2 * code + 1] + 32768) >> 16;
                vote(y + pad + down, x + pad + along);
                vote(y + pad - down, x + pad - along);
                continue;
            }
            for (int side = 0; side < 2; ++side) {
                // The offsets are sorted by direction. Those within the tolerance begin at the
                // first offset that is not below `least`, and may continue past the end at the
                // beginning.
                const int least = (code + side * (DIRECTIONS / 2) - tolerance) & (DIRECTIONS - 1);
                int low = begin, high = end;
                while (low < high) {
                    const int middle = (low + high) / 2;
                    if (codes[middle] < least)
                        low = middle + 1;
                    else
                        high = middle;
                }
                for (int k = 0; k < end - begin; ++k) {
                    const int at = low + k < end ? low + k : low + k - (end - begin);
                    if (((codes[at] - least) & (DIRECTIONS - 1)) > 2 * tolerance) break;
                    vote(y + pad + offsets[2 * at], x + pad + offsets[2 * at + 1]);
                }
            }
        }
        if (shares)
            for (size_t i = from; i < to; ++i) {
                const float share = (float)out[i] / (float)(end - begin);
                __builtin_memcpy(out + i, &share, 4);
            }
    }
}
