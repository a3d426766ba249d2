// Lay the entries of each word, for each bin, side by side at the size of a level, so that 16 of
// them get their cells at once. `words` (L, S, 3 (K + 1)) has first entries, least rows and largest.
void lay_level(int level, Ballot ballot, wp::array_t<int> words, wp::array_t<int> live) {
    const int* l = ballot.levels.data + 3 * level;
    const int count = ballot.begins.shape[0] - 1, bins = ballot.bins.shape[0];
    const size_t room = live.shape[2];
    int* down = live.data + (size_t)level * 4 * room;
    int *along = down + room, *scale = along + room, *weight = scale + room;
    const int at = l[0] - ballot.lowest, size = ballot.factors.shape[0];
    const wp::int64 factor = ballot.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
    const int all = ballot.begins.data[count];
    const int* entries = ballot.entries.data;
    const auto nearest = [&](int z) {
        int found = -1, slack = ballot.slack + 1;
        for (int k = 0; k < bins; ++k) {
            const int apart = __builtin_abs(z - ballot.bins.data[5 * k + 3]);
            if (apart < slack) slack = apart, found = k;
        }
        return found;
    };
    int next = 0;
    for (int s = 0; s < bins; ++s) {
        int* from = words.data + ((size_t)level * bins + s) * 3 * (count + 1);
        int *least = from + count + 1, *most = least + count + 1;
        int known = all ? entries[2] : 0, reached = nearest(l[0] + known);
        int lowest = 0x7fffffff, highest = -0x7fffffff;
        for (int word = 0; word < count; ++word) {
            from[word] = next;
            int low = 0x7fffffff, high = -0x7fffffff;
            const int end = ballot.begins.data[word + 1];
            for (int e = ballot.begins.data[word]; e < end; ++e) {
                const int* entry = entries + 4 * (size_t)e;
                if (entry[2] != known) known = entry[2], reached = nearest(l[0] + known);
                if (reached != s) continue;
                const int rows = (int)((entry[0] * factor + (1 << 15)) >> 16);
                down[next] = rows, along[next] = (int)((entry[1] * factor + (1 << 15)) >> 16);
                scale[next] = l[0] + known, weight[next++] = entry[3];
                low = rows < low ? rows : low, high = rows > high ? rows : high;
            }
            least[word] = low, most[word] = high;
            lowest = low < lowest ? low : lowest, highest = high > highest ? high : highest;
        }
        from[count] = next, least[count] = lowest, most[count] = highest;
    }
}

// needs LANES
// Count or list the votes for cells of a band: rows `band[1]` to `band[2]` of bin `band[0]`. Only
// cells that have room in `starts` are listed.
void cast_band(int number, Ballot ballot, wp::array_t<int> bands, wp::array_t<int> words,
               wp::array_t<int> live, wp::array_t<wp::uint64> cells, wp::array_t<int> sums,
               wp::array_t<int> counts, wp::array_t<int> votes) {
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    typedef float floats __attribute__((vector_size(4 * LANES)));
    const int* band = bands.data + 3 * number;
    const int* bin = ballot.bins.data + 5 * band[0];
    const int columns = bin[2], side = bin[4], span = (band[2] - band[1]) * columns;
    const int top = band[1] * side, bottom = band[2] * side, right = columns * side;
    const int first = bin[0] + band[1] * columns;
    const int count = ballot.begins.shape[0] - 1, bins = ballot.bins.shape[0];
    const int most = ballot.matches.shape[1];
    const size_t room = live.shape[2];
    // The cells of this band, then one for votes that are elsewhere, for each lane. When votes are
    // counted, a cell holds their number in its upper half, and the sum of weights in the lower.
    // When they are listed, it holds where its next vote goes, or -1.
    wp::uint64* own = cells.data + first + (size_t)LANES * number;
    wp::int64* next = (wp::int64*)own;
    for (int c = 0; c < span + LANES; ++c) own[c] = 0;
    if (ballot.listing) {
        const int* starts = ballot.starts.data + first;
        const int last = votes.shape[0];
        for (int c = 0; c < span; ++c)
            next[c] = starts[c + 1] > starts[c] && starts[c + 1] <= last ? starts[c] : -1;
        for (int j = 0; j < LANES; ++j) next[span + j] = -1;
    }
    lanes step;
    for (int j = 0; j < LANES; ++j) step[j] = j;
    const auto load = [](const int* at) __attribute__((always_inline)) {
        lanes value;
        __builtin_memcpy(&value, at, sizeof value);
        return value;
    };
    // Integer parts of quotients of integers below 2^24: the product with the inverse is off by 1.
    const auto divide = [](lanes n, int by, float inverse) __attribute__((always_inline)) {
        lanes q = __builtin_convertvector(__builtin_convertvector(n, floats) * inverse, lanes);
        const lanes rest = n - q * by;
        q -= rest >= by;
        return q + (rest < 0);
    };
    const float thin = 1.0f / (float)side;
    for (int level = 0; level < ballot.levels.shape[0]; ++level) {
        const int* l = ballot.levels.data + 3 * level;
        const int* from = words.data + ((size_t)level * bins + band[0]) * 3 * (count + 1);
        const int *least = from + count + 1, *largest = least + count + 1;
        if (from[0] == from[count]) continue;
        const int* down = live.data + (size_t)level * 4 * room;
        const int *along = down + room, *scale = along + room, *weight = scale + room;
        for (int line = l[1]; line < l[2]; ++line) {
            const int* row = ballot.rows.data + 3 * line;
            const int y = row[0];
            if (y + least[count] >= bottom || y + largest[count] < top) continue;
            for (int i = row[1]; i < row[2]; ++i) {
                const int* match = ballot.matches.data + (size_t)i * most;
                int active = 0;
                for (int m = 0; m < most; ++m) active += match[m] >= 0;
                const int x = ballot.places.data[3 * i + 1];
                const float part = 1.0f / (float)(active ? active : 1);
                for (int m = 0; m < active; ++m) {
                    const int word = match[m], behind = from[word + 1];
                    if (y + least[word] >= bottom || y + largest[word] < top) continue;
                    for (int v = from[word]; v < behind; v += LANES) {
                        const lanes r = load(down + v) + (y - top), c = load(along + v) + x;
                        const lanes there = (r >= 0) & (r < bottom - top) & (c >= 0) & (c < right) &
                                            (step < behind - v);
                        const lanes at = divide(r, side, thin) * columns + divide(c, side, thin);
                        const lanes share = divide(load(weight + v), active, part);
                        alignas(64) int cell[LANES], shares[LANES];
                        *(lanes*)cell = there ? at : step + span;
                        *(lanes*)shares = share;
                        if (!ballot.listing) {
#pragma unroll
                            for (int j = 0; j < LANES; ++j)
                                own[cell[j]] += (1ull << 32) + (unsigned int)shares[j];
                            continue;
                        }
                        int chosen[LANES], wanted = 0;
#pragma unroll
                        for (int j = 0; j < LANES; ++j) {
                            chosen[wanted] = j;
                            wanted += next[cell[j]] >= 0;
                        }
                        if (!wanted) continue;
                        // From 16 votes of each number to 4 numbers of each vote in turn.
                        const lanes z = load(scale + v);
                        alignas(64) int listed[4 * LANES];
                        const lanes row = r + top;
                        const lanes a = __builtin_shufflevector(row, c, 0, 16, 1, 17, 2, 18, 3, 19,
                                                                4, 20, 5, 21, 6, 22, 7, 23);
                        const lanes b = __builtin_shufflevector(z, share, 0, 16, 1, 17, 2, 18, 3,
                                                                19, 4, 20, 5, 21, 6, 22, 7, 23);
                        const lanes d = __builtin_shufflevector(row, c, 8, 24, 9, 25, 10, 26, 11,
                                                                27, 12, 28, 13, 29, 14, 30, 15, 31);
                        const lanes e = __builtin_shufflevector(z, share, 8, 24, 9, 25, 10, 26, 11,
                                                                27, 12, 28, 13, 29, 14, 30, 15, 31);
                        lanes* to16 = (lanes*)listed;
                        to16[0] = __builtin_shufflevector(a, b, 0, 1, 16, 17, 2, 3, 18, 19, 4, 5,
                                                          20, 21, 6, 7, 22, 23);
                        to16[1] = __builtin_shufflevector(a, b, 8, 9, 24, 25, 10, 11, 26, 27, 12,
                                                          13, 28, 29, 14, 15, 30, 31);
                        to16[2] = __builtin_shufflevector(d, e, 0, 1, 16, 17, 2, 3, 18, 19, 4, 5,
                                                          20, 21, 6, 7, 22, 23);
                        to16[3] = __builtin_shufflevector(d, e, 8, 9, 24, 25, 10, 11, 26, 27, 12,
                                                          13, 28, 29, 14, 15, 30, 31);
                        for (int k = 0; k < wanted; ++k) {
                            const int j = chosen[k];
                            const size_t to = next[cell[j]]++;
                            __builtin_memcpy(votes.data + 4 * to, listed + 4 * j, 16);
                        }
                    }
                }
            }
        }
    }
    if (ballot.listing) return;
    for (int c = 0; c < span; ++c) {
        sums.data[first + c] = (int)own[c];
        counts.data[first + c] = (int)(own[c] >> 32);
    }
}

// needs LANES, ONE, DEEPEST
// Move a maximum to a mode by mean shift; votes.py has the rule. 16 votes at a time.
//
// The kernel ONE - ONE d^2 / r^2 - deep of a vote, quotients rounded down, is above 0 if d^2 is
// below (ONE - deep) r^2 / ONE, rounded up. That limit depends on the distance in scale alone.
void shift_mode(int t, Cells cells, int radius, int scales, int rounds, wp::array_t<int> maxima,
                wp::array_t<int> modes) {
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    typedef wp::int64 longs __attribute__((vector_size(8 * LANES)));
    typedef double wide __attribute__((vector_size(8 * LANES)));
    int y = maxima.data[4 * t], x = maxima.data[4 * t + 1], z = maxima.data[4 * t + 2];
    wp::int64 mass, downs, alongs, deeps, density = 0;
    int limit[DEEPEST + 1], deep[DEEPEST + 1];
    const int listed = cells.votes.shape[0];
    for (int k = 0; k <= scales; ++k) deep[k] = ONE * k * k / (scales * scales);
    lanes step;
    for (int j = 0; j < LANES; ++j) step[j] = j;
    const auto add = [&](bool last) __attribute__((always_inline)) {
        const int at = z - cells.lowest, size = cells.factors.shape[0];
        const wp::int64 factor = cells.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
        const wp::int64 reach = (radius * factor + (1 << 15)) >> 16;
        for (int k = 0; k <= scales; ++k)
            limit[k] = (int)(((ONE - deep[k]) * reach * reach + ONE - 1) / ONE);
        longs weights = {}, down = {}, along = {}, far = {}, heights = {};
        for (int s = 0; s < cells.bins.shape[0]; ++s) {
            const int* bin = cells.bins.data + 5 * s;
            if (__builtin_abs(bin[3] - z) > scales + cells.slack) continue;
            const int side = bin[4], columns = bin[2], span = (int)reach;
            const int top = (y > span ? y - span : 0) / side;
            const int left = (x > span ? x - span : 0) / side;
            const int under = y + span < 0 ? 0 : (y + span) / side + 1;
            const int right = x + span < 0 ? 0 : (x + span) / side + 1;
            const int bottom = under < bin[1] ? under : bin[1];
            const int before = left < columns ? left : columns;
            const int past = right < columns ? right : columns;
            const int behind = past > before ? past : before;
            for (int row = top; row < bottom; ++row) {
                const int* cell = cells.starts.data + bin[0] + row * columns;
                const int end = cell[behind] < listed ? cell[behind] : listed;
                for (int v = cell[before]; v < end; v += LANES) {
                    const int n = end - v;
                    lanes a[4] = {};
                    const int* from = cells.votes.data + 4 * (size_t)v;
                    if (n >= LANES)
                        __builtin_memcpy(a, from, sizeof a);
                    else
                        __builtin_memcpy(a, from, (size_t)n * 16);
                    // From 4 numbers of each vote in turn to 16 votes of each number.
                    const lanes p = __builtin_shufflevector(a[0], a[1], 0, 4, 8, 12, 16, 20, 24, 28,
                                                            1, 5, 9, 13, 17, 21, 25, 29);
                    const lanes q = __builtin_shufflevector(a[2], a[3], 0, 4, 8, 12, 16, 20, 24, 28,
                                                            1, 5, 9, 13, 17, 21, 25, 29);
                    const lanes u = __builtin_shufflevector(a[0], a[1], 2, 6, 10, 14, 18, 22, 26,
                                                            30, 3, 7, 11, 15, 19, 23, 27, 31);
                    const lanes w = __builtin_shufflevector(a[2], a[3], 2, 6, 10, 14, 18, 22, 26,
                                                            30, 3, 7, 11, 15, 19, 23, 27, 31);
                    const lanes dy = __builtin_shufflevector(p, q, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17,
                                                             18, 19, 20, 21, 22, 23) -
                                     y;
                    const lanes dx = __builtin_shufflevector(p, q, 8, 9, 10, 11, 12, 13, 14, 15, 24,
                                                             25, 26, 27, 28, 29, 30, 31) -
                                     x;
                    const lanes dz = __builtin_shufflevector(u, w, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17,
                                                             18, 19, 20, 21, 22, 23) -
                                     z;
                    lanes weight = __builtin_shufflevector(u, w, 8, 9, 10, 11, 12, 13, 14, 15, 24,
                                                           25, 26, 27, 28, 29, 30, 31);
                    const lanes square = dy * dy + dx * dx;
                    const int one = dz[0];
                    lanes most = {}, less = {};
                    if (n >= LANES && !__builtin_reduce_or(dz ^ one)) {
                        const int apart = __builtin_abs(one);
                        most += apart > scales ? 0 : limit[apart];
                        less += apart > scales ? 0 : deep[apart];
                    } else {
                        for (int j = 0; j < LANES && j < n; ++j) {
                            const int apart = __builtin_abs(dz[j]);
                            if (apart > scales) continue;
                            most[j] = limit[apart], less[j] = deep[apart];
                        }
                    }
                    weight = square < most ? weight : (lanes){};
                    weights += __builtin_convertvector(weight, longs);
                    if (!last) {
                        down += __builtin_convertvector(weight * dy, longs);
                        along += __builtin_convertvector(weight * dx, longs);
                        far += __builtin_convertvector(weight * dz, longs);
                    } else {
                        const lanes flat = __builtin_convertvector(
                            __builtin_convertvector(square, wide) * ONE / (double)(reach * reach),
                            lanes);
                        heights += __builtin_convertvector(weight * (ONE - less - flat), longs);
                    }
                }
            }
        }
        mass = __builtin_reduce_add(weights);
        downs = __builtin_reduce_add(down) + y * mass;
        alongs = __builtin_reduce_add(along) + x * mass;
        deeps = __builtin_reduce_add(far) + (z - cells.lowest) * mass;
        density = __builtin_reduce_add(heights);
    };
    const auto mean = [&](wp::int64 sum) { return (int)((2 * sum + mass) / (2 * mass)); };
    if (maxima.data[4 * t + 3] > 0) {
        for (int round = 0; round < rounds; ++round) {
            add(false);
            if (!mass) break;
            const int row = mean(downs), column = mean(alongs), scale = mean(deeps) + cells.lowest;
            if (row == y && column == x && scale == z) break;
            y = row, x = column, z = scale;
        }
        add(true);
    }
    int* mode = modes.data + 4 * t;
    mode[0] = y, mode[1] = x, mode[2] = z, mode[3] = (int)(density / ONE);
}
