// needs LANES
// Cast the votes for the bins of a slab. The entries of a bin and a level are laid side by side
// first, at the size of the level, so that 16 entries of a word get their cells at once.
//
// Places stay below 2^24: the quotient of two such integers, rounded to a float, has the integer
// part of the exact one. The same holds for weights.
void cast_bins(int slab, int first, int last, Ballot ballot, wp::array_t<int> firsts,
               wp::array_t<int> live, wp::array_t<int> sums, wp::array_t<int> counts,
               wp::array_t<int> votes, wp::array_t<int> sources) {
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    typedef float floats __attribute__((vector_size(4 * LANES)));
    const int words = ballot.begins.shape[0] - 1, number = ballot.bins.shape[0];
    const int most = ballot.matches.shape[1];
    const size_t room = live.shape[2];
    int* from = firsts.data + (size_t)slab * (words + 1);
    int* down = live.data + (size_t)slab * 5 * room;
    int *along = down + room, *scale = along + room, *weight = scale + room, *of = weight + room;
    const auto load = [](const int* at) __attribute__((always_inline)) {
        lanes value;
        __builtin_memcpy(&value, at, sizeof value);
        return value;
    };
    lanes step;
    for (int j = 0; j < LANES; ++j) step[j] = j;
    for (int s = first; s < last; ++s) {
        const int* bin = ballot.bins.data + 5 * s;
        const int begin = bin[0], columns = bin[2], side = bin[4];
        const int bottom = bin[1] * side, right = columns * side;
        for (int level = 0; level < ballot.levels.shape[0]; ++level) {
            const int* l = ballot.levels.data + 3 * level;
            if (l[1] == l[2]) continue;
            const int at = l[0] - ballot.lowest, size = ballot.factors.shape[0];
            const wp::int64 factor = ballot.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
            int count = 0, known = 0, nearest = -2;
            for (int word = 0; word < words; ++word) {
                from[word] = count;
                for (int e = ballot.begins.data[word]; e < ballot.begins.data[word + 1]; ++e) {
                    const int* entry = ballot.entries.data + 4 * (size_t)e;
                    if (nearest == -2 || entry[2] != known) {
                        known = entry[2], nearest = -1;
                        int least = ballot.slack + 1;
                        for (int k = 0; k < number; ++k) {
                            const int own = ballot.bins.data[5 * k + 3];
                            const int apart = __builtin_abs(l[0] + known - own);
                            if (apart < least) least = apart, nearest = k;
                        }
                    }
                    if (nearest != s) continue;
                    down[count] = (int)((entry[0] * factor + (1 << 15)) >> 16);
                    along[count] = (int)((entry[1] * factor + (1 << 15)) >> 16);
                    scale[count] = l[0] + known, weight[count] = entry[3], of[count++] = e;
                }
            }
            from[words] = count;
            if (!count) continue;
            const int end = ballot.rows.data[3 * (l[2] - 1) + 2];
            for (int i = ballot.rows.data[3 * l[1] + 1]; i < end; ++i) {
                const int* match = ballot.matches.data + (size_t)i * most;
                int active = 0;
                for (int m = 0; m < most; ++m) active += match[m] >= 0;
                const int y = ballot.places.data[3 * i], x = ballot.places.data[3 * i + 1];
                for (int m = 0; m < active; ++m) {
                    const int behind = from[match[m] + 1];
                    for (int v = from[match[m]]; v < behind; v += LANES) {
                        const lanes row = load(down + v) + y, column = load(along + v) + x;
                        const lanes there = (row >= 0) & (row < bottom) & (column >= 0) &
                                            (column < right) & (step < behind - v);
                        const lanes r = __builtin_convertvector(
                            __builtin_convertvector(row, floats) / (float)side, lanes);
                        const lanes c = __builtin_convertvector(
                            __builtin_convertvector(column, floats) / (float)side, lanes);
                        const lanes part = __builtin_convertvector(
                            __builtin_convertvector(load(weight + v), floats) / (float)active,
                            lanes);
                        alignas(64) int cell[LANES], share[LANES];
                        *(lanes*)cell = there ? begin + r * columns + c : (lanes){} - 1;
                        *(lanes*)share = part;
                        const int n = behind - v < LANES ? behind - v : LANES;
                        for (int j = 0; j < n; ++j) {
                            if (cell[j] < 0) continue;
                            if (!ballot.listing) {
                                sums.data[cell[j]] += share[j];
                                ++counts.data[cell[j] + 1];
                                continue;
                            }
                            const size_t to = ballot.starts.data[cell[j]] + counts.data[cell[j]]++;
                            int* vote = votes.data + 4 * to;
                            vote[0] = y + down[v + j], vote[1] = x + along[v + j];
                            vote[2] = scale[v + j], vote[3] = share[j];
                            sources.data[2 * to] = i, sources.data[2 * to + 1] = of[v + j];
                        }
                    }
                }
            }
        }
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
                const int end = cell[behind];
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
