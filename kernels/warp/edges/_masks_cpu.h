// needs INTERPOLATED SECTOR_ONE SECTOR_LOW SECTOR_HIGH
// Write the states of the pixels of row y in some columns. `rows` has the rows of `dy` and `dx`, and
// the first line. A maximum along the gradient has state 1 above the first limit and 2 above the
// second; all other pixels have 0. _thinning_cuda.py has the same rules for one pixel. `lines` holds
// the values that neighbours are compared by: three rows, row r in line r mod 3 from the first on,
// between margins of one. The letters are compass directions. All neighbours are read, because a
// choice before reading would prevent vector code. The arrays are views of vectors that start at
// each float.
void thin_row(int y, wp::array_t<Wide> dy, wp::array_t<Wide> dx, int margin,
              wp::array_t<Wide> lines, wp::vec3i rows, wp::vec2i columns, int norm,
              wp::vec2f limits, bool framed, wp::array_t<wp::uint8> states) {
#pragma clang fp contract(off)
    const float low = limits[0], high = limits[1];
    const int first = rows[2];
    const auto row_of = [](const auto& wide, int row) {
        return (const float*)((const char*)wide.data + (size_t)row * wide.strides[0]);
    };
    const float* down = row_of(dy, rows[0]) + margin;
    const float* along = row_of(dx, rows[1]) + margin;
    const float* above = row_of(lines, first + (y + 2) % 3) + 1;
    const float* here = row_of(lines, first + y % 3) + 1;
    const float* below = row_of(lines, first + (y + 1) % 3) + 1;
    unsigned char* __restrict__ state = states.data + (size_t)y * states.shape[1];
    // A lower bound of the compared value of a pixel above `low`. The rounded root of two different
    // numbers may be equal, so the bound is a little below the root of `low`.
    const float least = INTERPOLATED && norm ? 0.999f * wp::sqrt(low) : low;
    for (int begin = columns[0]; begin < columns[1]; begin += 64) {
        const int end = begin + 64 < columns[1] ? begin + 64 : columns[1];
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

// needs SUMS DIFFERENCES DOWN ALONG MEASURES
// Write the derivatives of row y in some columns and beside them, and the values that neighbours
// are compared by. `rows` has the rows above and below, `ends` the columns that the border puts
// before the first and after the last; -1 means `cval`. `columns` are the first one, the one after
// the last, and all. The lines of the slab begin at `base`.
void sobel_row(int y, wp::array_t<Bytes> src, wp::vec2i rows, wp::vec2i ends, wp::vec3i columns,
               float cval, int norm, wp::array_t<float> lines, int base) {
#pragma clang fp contract(off)
    const auto line = [&](int k) { return lines.data + (size_t)(base + k) * lines.shape[1] + 1; };
    const auto row = [&](int k) {
        return (const unsigned char*)src.data + (size_t)(k < 0 ? 0 : k) * src.strides[0];
    };
    const int width = columns[2], third = (y + 3) % 3;
    const unsigned char *over = row(rows[0]), *here = row(y), *under = row(rows[1]);
    float* __restrict__ sums = line(SUMS);
    float* __restrict__ differences = line(DIFFERENCES);
    const auto down_at = [&](int x, int to) {
        const float a = rows[0] < 0 ? cval : (float)over[x], b = (float)here[x];
        const float c = rows[1] < 0 ? cval : (float)under[x];
        sums[to] = a + b + b + c;
        differences[to] = c - a;
    };
    const int begin = columns[0] > 2 ? columns[0] - 2 : 0;
    const int end = columns[1] + 2 < width ? columns[1] + 2 : width;
    if (rows[0] >= 0 && rows[1] >= 0) {
#pragma clang loop vectorize(assume_safety)
        for (int x = begin; x < end; ++x) {
            const float a = (float)(int)over[x], b = (float)(int)here[x], c = (float)(int)under[x];
            sums[x] = a + b + b + c;
            differences[x] = c - a;
        }
    } else {
        for (int x = begin; x < end; ++x) down_at(x, x);
    }
    for (int side = 0; side < 2; ++side) {
        const int x = side ? width : -1, inside = ends[side];
        if (inside >= 0)
            down_at(inside, x);
        else
            sums[x] = 4.0f * cval, differences[x] = 0.0f;
    }
    float* __restrict__ down = line(DOWN + third);
    float* __restrict__ along = line(ALONG + third);
    float* __restrict__ measures = line(MEASURES + third);
    const int stop = columns[1] < width ? columns[1] + 1 : width;
#pragma clang loop vectorize(assume_safety)
    for (int x = columns[0] > 0 ? columns[0] - 1 : 0; x < stop; ++x) {
        const float middle = differences[x];
        const float dy = differences[x - 1] + middle + middle + differences[x + 1];
        const float dx = sums[x + 1] - sums[x - 1];
        down[x] = dy;
        along[x] = dx;
        measures[x] = norm == 0 ? __builtin_fabsf(dx) + __builtin_fabsf(dy) : dx * dx + dy * dy;
    }
    measures[-1] = measures[width] = 0.0f;  // the gradient beside a row is 0
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
        unsigned long long eight = 0, old;
        while (i + 8 <= last) {  // skip pixels without such a state
            __builtin_memcpy(&eight, state + i, 8);
            if (eight & (least == 2 ? 0x0202020202020202ull : 0x0303030303030303ull)) break;
            i += 8;
        }
        if (i + 8 <= last) {  // skip those that are kept
            __builtin_memcpy(&old, kept + i, 8);
            eight = (eight >> 1 | (least == 1 ? eight : 0)) & ~old & 0x0101010101010101ull;
            i += eight ? __builtin_ctzll(eight) / 8 : 7;
            if (!eight) continue;
        } else if (i == last || state[i] < least || kept[i]) {
            continue;
        }
        wp::vec_t<2, int>* top = bottom;
        kept[i] = 1;
        *top++ = wp::vec_t<2, int>(i, i % width);
        while (top > bottom) {
            const wp::vec_t<2, int> pixel = *--top;
            const int x = pixel[1], row = pixel[0] - x;
            // Read four columns with the neighbours among them, and leave a bit per neighbour.
            const int from = x < 1 ? 0 : x - 1 < width - 4 ? x - 1 : width < 4 ? 0 : width - 4;
            unsigned beside = 0x070707u;
            if (from != x - 1)
                for (int k = beside = 0; k < 4; ++k)
                    if (from + k >= x - 1 && from + k <= x + 1) beside |= 7u << 8 * k;
            const auto fresh = [&](int at) __attribute__((always_inline)) {
                unsigned some = 0, old = 0;
                const int size = width < 4 ? width : 4;
                if (at < start || at >= stop) return 0u;
                if (size == 4) {
                    __builtin_memcpy(&some, state + at + from, 4);
                    __builtin_memcpy(&old, kept + at + from, 4);
                } else {
                    __builtin_memcpy(&some, state + at, size);
                    __builtin_memcpy(&old, kept + at, size);
                }
                return (some | some >> 1) & ~old & 0x01010101u;
            };
            unsigned next = fresh(row - width) | fresh(row) << 1 | fresh(row + width) << 2;
            for (next &= beside; next; next &= next - 1) {
                const int bit = __builtin_ctz(next), column = from + bit / 8;
                const int at = row + (bit % 8 - 1) * width + column;
                kept[at] = 1;
                *top++ = wp::vec_t<2, int>(at, column);
            }
        }
    }
}
