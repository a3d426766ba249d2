// needs COLUMNS, ROWS, WORDS
// Smooth images by the same symmetric taps down the rows and then along them: the middle, then
// pairs of elements from the inner ones outwards; an image is mirrored about its outermost pixels.
// A job is (source, result, half of its size or 0, rows, columns, middle tap, reach, blocks). A
// block computes ROWS rows; a thread first sums down a column of them, with its elements in
// registers, then along quads of a row.
void smooth(int first, wp::array_t<wp::int64> jobs) {
    __shared__ float4 tile[ROWS][COLUMNS / 4];
    int block = blockIdx.x;
    const wp::int64* job = jobs.data + (size_t)WORDS * first;
    for (; block >= (int)job[7]; job += WORDS) block -= (int)job[7];
    const float* const src = (const float*)job[0];
    float *const dst = (float*)job[1], *const half = (float*)job[2];
    const int height = (int)job[3], width = (int)job[4];
    const float* const tap = (const float*)job[5];
    const int thread = threadIdx.x;
    const bool quads = width % 4 == 0;  // all addresses are multiples of 256 bytes, or of rows
    const auto store = [&](int y, int x, const float* v) {
        float* const to = dst + (size_t)y * width + x;
        if (quads)
            *(float4*)to = make_float4(v[0], v[1], v[2], v[3]);
        else
            for (int e = 0; e < 4; ++e)
                if (x + e < width) to[e] = v[e];
        if (half == nullptr || y % 2 || y / 2 >= height / 2) return;
        float* const below = half + (size_t)(y / 2) * (width / 2) + x / 2;
        if (x / 2 < width / 2) below[0] = v[0];
        if (x / 2 + 1 < width / 2) below[1] = v[2];
    };
    // `one` is an array of as many bytes as the taps reach, so that loops have constant ends.
    const auto run = [&](auto* one) {
        enum { REACH = sizeof(*one), SIDE = (REACH + 3) / 4 * 4, WIDE = COLUMNS - 2 * SIDE };
        const int across = (width + WIDE - 1) / WIDE;
        const int top = block / across * ROWS, left = block % across * WIDE;
        // One mirror is enough, as the image is larger than REACH; nobody uses what is clamped.
        const auto mirrored = [](int i, int size) {
            const int k = i < 0 ? -i : i;
            return max(k < size ? k : 2 * size - 2 - k, 0);
        };
        float w[REACH + 1];
        for (int t = 0; t <= REACH; ++t) w[t] = __ldg(tap + t);
        {
            const float* const column = src + mirrored(left - SIDE + thread, width);
            float v[ROWS + 2 * REACH];
            if (top >= REACH && top + ROWS + REACH <= height) {
                const float* const p = column + (size_t)(top - REACH) * width;
#pragma unroll
                for (int i = 0; i < ROWS + 2 * REACH; ++i) v[i] = __ldg(p + (size_t)i * width);
            } else {
#pragma unroll
                for (int i = 0; i < ROWS + 2 * REACH; ++i)
                    v[i] = __ldg(column + (size_t)mirrored(top - REACH + i, height) * width);
            }
#pragma unroll
            for (int k = 0; k < ROWS; ++k) {
                float sum = w[0] * v[k + REACH];
#pragma unroll
                for (int t = 1; t <= REACH; ++t)
                    sum += w[t] * (v[k + REACH - t] + v[k + REACH + t]);
                ((float*)tile[k])[thread] = sum;
            }
        }
        __syncthreads();
        for (int n = thread; n < ROWS * (WIDE / 4); n += COLUMNS) {
            const int row = n / (WIDE / 4), quad = n % (WIDE / 4);
            const int y = top + row, x = left + 4 * quad;
            if (y >= height || x >= width) continue;
            float v[4 + 2 * SIDE], sum[4];
#pragma unroll
            for (int i = 0; i < 1 + SIDE / 2; ++i) {
                const float4 four = tile[row][quad + i];
                v[4 * i] = four.x, v[4 * i + 1] = four.y, v[4 * i + 2] = four.z,
                      v[4 * i + 3] = four.w;
            }
#pragma unroll
            for (int e = 0; e < 4; ++e) {
                sum[e] = w[0] * v[SIDE + e];
#pragma unroll
                for (int t = 1; t <= REACH; ++t)
                    sum[e] += w[t] * (v[SIDE + e - t] + v[SIDE + e + t]);
            }
            store(y, x, sum);
        }
    };
    const int reach = (int)job[6];
    if (min(height, width) > reach) switch (reach) {
            case 4:
                return run((char (*)[4]) nullptr);
            case 5:
                return run((char (*)[5]) nullptr);
            case 6:
                return run((char (*)[6]) nullptr);
            case 7:
                return run((char (*)[7]) nullptr);
            case 9:
                return run((char (*)[9]) nullptr);
            case 11:
                return run((char (*)[11]) nullptr);
        }
    // Any other taps, or a small image.
    const int side = (reach + 3) / 4 * 4, wide = COLUMNS - 2 * side;
    const int across = (width + wide - 1) / wide;
    const int top = block / across * ROWS, left = block % across * wide;
    const auto mirrored = [](int i, int size) {
        if (size == 1) return 0;
        const int period = 2 * (size - 1), k = (i % period + period) % period;
        return k < size ? k : period - k;
    };
    const float* const column = src + mirrored(left - side + thread, width);
    for (int k = 0; k < ROWS; ++k) {
        float sum = tap[0] * column[(size_t)mirrored(top + k, height) * width];
        for (int t = 1; t <= reach; ++t)
            sum += tap[t] * (column[(size_t)mirrored(top + k - t, height) * width] +
                             column[(size_t)mirrored(top + k + t, height) * width]);
        ((float*)tile[k])[thread] = sum;
    }
    __syncthreads();
    for (int n = thread; n < ROWS * (wide / 4); n += COLUMNS) {
        const int row = n / (wide / 4), at = 4 * (n % (wide / 4));
        const int y = top + row, x = left + at;
        if (y >= height || x >= width) continue;
        const float* const middle = (const float*)tile[row] + side + at;
        float sum[4];
        for (int e = 0; e < 4; ++e) {
            sum[e] = tap[0] * middle[e];
            for (int t = 1; t <= reach; ++t) sum[e] += tap[t] * (middle[e - t] + middle[e + t]);
        }
        store(y, x, sum);
    }
}
