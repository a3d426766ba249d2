// Smaller sizes of an image of bytes on the CPU; taichi/features/binary.py has the rule.

// Make sizes 1, 2, ... of an image, each of the one before, in groups of 32 rows. Bytes are weighed
// down the rows, then turned, so that 32 pixels below each other, which share their weights along
// the row, are a vector. Threads take the next group, larger sizes first, and mark it when it is
// done: `shared` holds the number of groups taken, and then a mark for each. A thread that would
// have to wait for the rows that a group needs ends instead; who makes those rows goes on.
//
// The table of images has address, 1, height and width of each. Starts and weights are those of the
// rows and then of the columns, of all sizes one after the other; starts do not descend.
void make_sizes(wp::array_t<wp::int64> images, wp::array_t<int> starts,
                wp::array_t<wp::uint8> weights, wp::array_t<int> shared) {
    typedef unsigned char byte;
    enum { ROWS = 32, WIDE = 64, READ = 256, SIDE = 16 };
    typedef byte many __attribute__((vector_size(WIDE)));
    typedef unsigned short many_sums __attribute__((vector_size(2 * WIDE)));
    typedef byte lanes __attribute__((vector_size(ROWS)));
    typedef unsigned short sums __attribute__((vector_size(2 * ROWS)));
    typedef byte half __attribute__((vector_size(SIDE)));
    const int taps = weights.shape[1];
    // Interleaving rows i and i + 8 four times turns two squares of 16 x 16 bytes.
    const auto turn = [](lanes* v) {
#pragma unroll
        for (int times = 0; times < 4; ++times) {
            lanes made[SIDE];
#pragma unroll
            for (int i = 0; i < SIDE / 2; ++i) {
                const lanes a = v[i], b = v[i + SIDE / 2];
                made[2 * i] = __builtin_shufflevector(a, b, 0, 32, 1, 33, 2, 34, 3, 35, 4, 36, 5,
                                                      37, 6, 38, 7, 39, 16, 48, 17, 49, 18, 50, 19,
                                                      51, 20, 52, 21, 53, 22, 54, 23, 55);
                made[2 * i + 1] = __builtin_shufflevector(
                    a, b, 8, 40, 9, 41, 10, 42, 11, 43, 12, 44, 13, 45, 14, 46, 15, 47, 24, 56, 25,
                    57, 26, 58, 27, 59, 28, 60, 29, 61, 30, 62, 31, 63);
            }
#pragma unroll
            for (int i = 0; i < SIDE; ++i) v[i] = made[i];
        }
    };
    // A parameter of 64 bytes allows the registers of 64 bytes in this function.
    const auto widened = [](many v) __attribute__((always_inline)) {
        return __builtin_convertvector(v, many_sums);
    };
    int* const marks = shared.data + 1;
    for (;;) {
        // The next group, its size, and where the weights of this size begin.
        int task = __atomic_load_n(shared.data, __ATOMIC_RELAXED);
        int level = 1, before = 0, earlier = 0;
        size_t at = 0;
        const wp::int64* to = images.data + 4;
        for (; level < images.shape[0]; ++level, to += 4) {
            const int groups = ((int)to[2] + ROWS - 1) / ROWS;
            if (task < before + groups) break;
            at += to[2] + to[3];
            earlier = before;
            before += groups;
        }
        if (level == images.shape[0]) return;
        const byte* const src = (const byte*)to[-4];
        byte* const dst = (byte*)to[0];
        const int height = (int)to[-2], width = (int)to[-1], tall = (int)to[2], m = (int)to[3];
        const int top = (task - before) * ROWS, rows = tall - top < ROWS ? tall - top : ROWS;
        const int *const tops = starts.data + at, *const starting = tops + tall;
        const byte *const down = weights.data + at * taps, *const along = down + tall * taps;
        if (level > 1) {
            const int most = tops[top + rows - 1] + taps - 1;
            const int end = (most < height ? most : height - 1) / ROWS;
            for (int group = tops[top] / ROWS; group <= end; ++group)
                if (!__atomic_load_n(marks + earlier + group, __ATOMIC_ACQUIRE)) return;
        }
        if (!__atomic_compare_exchange_n(shared.data, &task, task + 1, false, __ATOMIC_RELAXED,
                                         __ATOMIC_RELAXED))
            continue;
        if (width < WIDE) {  // one pixel after the other
            for (int y = top; y < top + rows; ++y)
                for (int x = 0; x < m; ++x) {
                    int sum = 64;
                    for (int t = 0; t < taps; ++t) {
                        const int w = along[(size_t)x * taps + t], column = starting[x] + t;
                        int v = 64;
                        for (int s = 0; w && s < taps; ++s)
                            if (const int u = down[(size_t)y * taps + s])
                                v += u * src[(size_t)(tops[y] + s) * width + column];
                        sum += w * (v >> 7);
                    }
                    dst[(size_t)y * m + x] = (byte)(sum >> 7);
                }
        } else {
            byte lines[ROWS][READ];
            lanes read[READ + SIDE], made[READ + SIDE];
            for (int k = 0; k < m;) {
                // Weigh 256 columns down the rows, from the first that pixel `k` needs.
                const int low = starting[k] < width - WIDE ? starting[k] : width - WIDE;
                const int wide = width - low < READ ? width - low : READ;
                int end = k;
                while (end < m && starting[end] + taps <= low + READ) ++end;
                if (wide < READ) end = m;
                for (int r = 0; r < ROWS; ++r) {
                    const size_t y = r < rows ? top + r : tall - 1;
                    const byte* const w = down + y * taps;
                    const byte* const from = src + (size_t)tops[y] * width + low;
                    for (int next = 0; next < wide; next += WIDE) {
                        const int x = next + WIDE < wide ? next : wide - WIDE;
                        many_sums sum = (many_sums){} + (unsigned short)64;
                        const byte* p = from + x;
                        // What the next columns read.
                        __builtin_prefetch(p + READ + (taps - 2) * width);
                        __builtin_prefetch(p + READ + (taps - 1) * width);
#pragma clang loop unroll(disable)
                        for (int s = 0; s < taps; ++s, p += width) {
                            // A weight of 0 may be that of a row that is not there.
                            if (w[s] == 0) continue;
                            many v;
                            __builtin_memcpy(&v, p, WIDE);
                            sum += (unsigned short)w[s] * widened(v);
                        }
                        const many done = __builtin_convertvector(sum >> 7, many);
                        __builtin_memcpy(lines[r] + x, &done, WIDE);
                    }
                }
                for (int next = 0; next < wide; next += SIDE) {
                    const int x = next + SIDE < wide ? next : wide - SIDE;
                    lanes v[SIDE];
#pragma unroll
                    for (int i = 0; i < SIDE; ++i) {
                        __builtin_memcpy(&v[i], lines[i] + x, SIDE);
                        __builtin_memcpy((byte*)&v[i] + SIDE, lines[i + SIDE] + x, SIDE);
                    }
                    turn(v);
#pragma unroll
                    for (int i = 0; i < SIDE; ++i) read[x + i] = v[i];
                }
                const auto weigh = [&](const int count) __attribute__((always_inline)) {
                    for (int x = k; x < end; ++x) {
                        const byte* const w = along + (size_t)x * taps;
                        const lanes* const p = read + starting[x] - low;
                        sums sum = (sums){} + (unsigned short)64;
#pragma unroll
                        for (int t = 0; t < count; ++t)
                            sum += (unsigned short)w[t] * __builtin_convertvector(p[t], sums);
                        made[x - k] = __builtin_convertvector(sum >> 7, lanes);
                    }
                };
                if (taps == 3)
                    weigh(3);
                else
                    weigh(taps);
                for (int x = k; x < end; x += SIDE) {
                    lanes v[SIDE];
#pragma unroll
                    for (int i = 0; i < SIDE; ++i) v[i] = made[x - k + i];
                    turn(v);
                    const int count = end - x < SIDE ? end - x : SIDE;
                    byte* const to = dst + (size_t)top * m + x;
                    if (rows == ROWS && count == SIDE) {
#pragma unroll
                        for (int i = 0; i < SIDE; ++i) {
                            __builtin_memcpy(to + (size_t)i * m, &v[i], SIDE);
                            __builtin_memcpy(to + (size_t)(i + SIDE) * m, (byte*)&v[i] + SIDE,
                                             SIDE);
                        }
                    } else {
                        for (int r = 0; r < rows; ++r)
                            __builtin_memcpy(to + (size_t)r * m,
                                             (byte*)&v[r % SIDE] + r / SIDE * SIDE, count);
                    }
                }
                k = end;
            }
        }
        __atomic_store_n(marks + task, 1, __ATOMIC_RELEASE);
    }
}
