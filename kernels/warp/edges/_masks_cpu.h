// needs INTERPOLATED SECTOR_ONE SECTOR_LOW SECTOR_HIGH
// Write the states of the pixels of row y. A maximum along the gradient has state 1 above the first
// limit and 2 above the second; all other pixels have 0. _thinning_cuda.py has the same rules for
// one pixel. `lines` holds the values that neighbours are compared by: three rows, beginning at
// line `first`, row r in line r mod 3, between margins of one. The letters are compass directions.
// All neighbours are read, because a choice before reading would prevent vector code. The arrays
// are views of vectors that start at each float.
void thin_row(int y, wp::array_t<Wide> dy, int dy_row, wp::array_t<Wide> dx, int dx_row, int margin,
              wp::array_t<Wide> lines, int first, int norm, wp::vec2f limits, bool framed,
              wp::array_t<wp::uint8> states) {
#pragma clang fp contract(off)
    const float low = limits[0], high = limits[1];
    const int columns = states.shape[1];
    const auto row_of = [](const auto& wide, int row) {
        return (const float*)((const char*)wide.data + (size_t)row * wide.strides[0]);
    };
    const float* down = row_of(dy, dy_row) + margin;
    const float* along = row_of(dx, dx_row) + margin;
    const float* above = row_of(lines, first + (y + 2) % 3) + 1;
    const float* here = row_of(lines, first + y % 3) + 1;
    const float* below = row_of(lines, first + (y + 1) % 3) + 1;
    unsigned char* __restrict__ state = states.data + (size_t)y * columns;
    // A lower bound of the compared value of a pixel above `low`. The rounded root of two different
    // numbers may be equal, so the bound is a little below the root of `low`.
    const float least = INTERPOLATED && norm ? 0.999f * wp::sqrt(low) : low;
    for (int begin = 0; begin < columns; begin += 64) {
        const int end = begin + 64 < columns ? begin + 64 : columns;
        int found = 0;  // stays 0 in most of a photograph
        for (int x = begin; x < end; ++x) found |= here[x] > least;
        if (!found) {
            for (int x = begin; x < end; ++x) state[x] = 0;
            continue;
        }
#pragma clang loop vectorize(assume_safety)
        for (int x = begin; x < end; ++x) {
            const float nw = above[x - 1], n = above[x], ne = above[x + 1];
            const float w = here[x - 1], c = here[x], e = here[x + 1];
            const float sw = below[x - 1], s = below[x], se = below[x + 1];
            const float ax = __builtin_fabsf(along[x]), ay = __builtin_fabsf(down[x]);
            const bool opposite = (along[x] < 0.0f) != (down[x] < 0.0f);
            bool kept;
            if (INTERPOLATED) {
                const bool downward = ay > ax;
                const float large = downward ? ay : ax, small = downward ? ax : ay;
                const float rest = large - small;
                const float corner_back = opposite ? (downward ? ne : sw) : nw;
                const float corner_ahead = opposite ? (downward ? sw : ne) : se;
                const float back = (downward ? n : w) * rest + corner_back * small;
                const float ahead = (downward ? s : e) * rest + corner_ahead * small;
                const float top = c * large;
                kept = ((top > back) | (framed & (top == back))) & (top >= ahead);
            } else {
                const float steep = ay * (float)SECTOR_ONE;
                const bool across = steep < ax * (float)SECTOR_LOW;
                const bool downward = steep > ax * (float)SECTOR_HIGH;
                const float back = across ? w : downward ? n : opposite ? ne : nw;
                const float ahead = across ? e : downward ? s : opposite ? sw : se;
                kept = (c > back) & ((c > ahead) | ((across | downward) & (c == ahead)));
            }
            const float m = norm == 0 ? ax + ay : along[x] * along[x] + down[x] * down[x];
            state[x] = (kept & (m > low)) ? 1 + (m > high) : 0;
        }
    }
}

// Keep all pixels between `start` and `stop` that are 8-connected with a pixel between `first` and
// `last` whose state is at least `least`. The stack, which begins at `room`, holds pixels and their
// columns.
void flood(int first, int last, int least, int start, int stop, wp::array_t<wp::uint8> states,
           int width, int room, wp::array_t<wp::vec2i> stack, wp::array_t<wp::uint8> mask) {
    const unsigned char* state = states.data;
    unsigned char* kept = mask.data;
    wp::vec_t<2, int>* const bottom = stack.data + room;
    for (int i = first; i < last; ++i) {
        unsigned long long eight = 0;
        while (i + 8 <= last) {  // skip pixels without such a state
            __builtin_memcpy(&eight, state + i, 8);
            if (eight & (least == 2 ? 0x0202020202020202ull : 0x0303030303030303ull)) break;
            i += 8;
        }
        if (i == last) break;
        if (state[i] < least || kept[i]) continue;
        wp::vec_t<2, int>* top = bottom;
        kept[i] = 1;
        *top++ = wp::vec_t<2, int>(i, i % width);
        while (top > bottom) {
            const wp::vec_t<2, int> pixel = *--top;
            const int x = pixel[1], left = x > 0 ? -1 : 0, right = x + 1 < width ? 1 : 0;
            for (int row = pixel[0] - width; row <= pixel[0] + width; row += width) {
                if (row - x < start || row - x >= stop) continue;
                for (int dx = left; dx <= right; ++dx) {
                    // Avoid a branch, which could not be predicted.
                    const unsigned char next = (state[row + dx] != 0) & (kept[row + dx] == 0);
                    kept[row + dx] |= next;
                    *top = wp::vec_t<2, int>(row + dx, x + dx);
                    top += next;
                }
            }
        }
    }
}
