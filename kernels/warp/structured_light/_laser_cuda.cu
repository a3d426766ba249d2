// Laser lines on CUDA: many threads look at each line, and give what one alone would have found.

// needs TYPE, WARPS
// The brightest window of each column. A block has 32 columns of a frame; each of its warps looks at
// some of the rows. Of equal windows the first one is taken.
void find_in_columns(wp::array_t<TYPE> frames, int half, wp::array_t<int> places) {
    __shared__ float totals[WARPS][32];
    __shared__ int found[WARPS][32];
    const int height = frames.shape[1], width = frames.shape[2];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const unsigned blocks = (unsigned)(width + 31) / 32;
    const int n = (int)(blockIdx.x / blocks), line = (int)(blockIdx.x % blocks) * 32 + lane;
    if (n >= places.shape[0]) return;  // the whole block
    const int first = (int)((long long)height * warp / WARPS);
    const int last = (int)((long long)height * (warp + 1) / WARPS);
    const TYPE* column =
        frames.data + (size_t)n * height * width + (line < width ? line : width - 1);
    float best = __int_as_float(0xff800000);
    int place = -1;
    for (int p = first; p < last; ++p) {
        float total = 0.0f;
        for (int i = p - half; i <= p + half; ++i)
            total += (float)column[(size_t)min(max(i, 0), height - 1) * width];
        if (total > best) best = total, place = p;
    }
    totals[warp][lane] = best, found[warp][lane] = place;
    __syncthreads();
    if (warp > 0 || line >= width) return;
    for (int other = 1; other < WARPS; ++other)
        if (totals[other][lane] > best) best = totals[other][lane], place = found[other][lane];
    places.data[(size_t)n * width + line] = place;
}

// needs TYPE
// The brightest window of each row, by a warp.
void find_in_rows(wp::array_t<TYPE> frames, int half, wp::array_t<int> places) {
    const int width = frames.shape[2], lane = threadIdx.x & 31;
    const size_t line = (blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5;
    if (line >= (size_t)places.shape[0] * places.shape[1]) return;  // the whole warp
    const TYPE* row = frames.data + line * width;
    float best = __int_as_float(0xff800000);
    int place = -1;
    for (int p = lane; p < width; p += 32) {
        float total = 0.0f;
        for (int i = p - half; i <= p + half; ++i) total += (float)row[min(max(i, 0), width - 1)];
        if (total > best) best = total, place = p;
    }
    for (int half_warp = 16; half_warp > 0; half_warp /= 2) {
        const float other = __shfl_xor_sync(0xffffffffu, best, half_warp);
        const int at = __shfl_xor_sync(0xffffffffu, place, half_warp);
        if (other > best || (other == best && at < place)) best = other, place = at;
    }
    if (lane == 0) places.data[line] = place;
}

// needs TYPE, MOVES, OFFSET, LEAST
// Places by Steger's rule, a warp a line: a lane sums along the line's neighbours at one distance,
// and all add these sums up in the order in which one thread would.
void find_ridges(wp::array_t<TYPE> frames, int axis, wp::array_t<int> places,
                 wp::array_t<float> taps, float scale, float curve, wp::array_t<float> positions,
                 wp::array_t<float> strengths) {
    const int lane = threadIdx.x & 31, lines = places.shape[1];
    const size_t number = (blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5;
    if (number >= (size_t)places.shape[0] * lines) return;  // the whole warp
    const int height = frames.shape[1], width = frames.shape[2];
    const int line = (int)(number % lines), size = axis ? width : height;
    const TYPE* frame = frames.data + number / lines * height * width;
    const int count = taps.shape[1], radius = count / 2;
    const float *smooth = taps.data, *first = smooth + count, *second = first + count;
    float position = __int_as_float(0x7fc00000), strength = 0.0f;
    int p = places.data[number], moves = 0;
    while (p >= 0 && moves < MOVES) {
        float rp = 0.0f, rl = 0.0f, rpp = 0.0f, rpl = 0.0f, rll = 0.0f;
        for (int begin = 0; begin < count; begin += 32) {
            const int i = begin + lane, here = min(32, count - begin);
            const int at = min(max(p + min(i, count - 1) - radius, 0), size - 1);
            float a0 = 0.0f, a1 = 0.0f, a2 = 0.0f;
            for (int j = 0; j < count; ++j) {
                const int beside = min(max(line + j - radius, 0), lines - 1);
                const float v = (float)(axis ? frame[(size_t)beside * width + at]
                                             : frame[(size_t)at * width + beside]);
                a0 += v * smooth[j], a1 += v * first[j], a2 += v * second[j];
            }
            for (int k = 0; k < here; ++k) {
                const float b0 = __shfl_sync(0xffffffffu, a0, k);
                const float b1 = __shfl_sync(0xffffffffu, a1, k);
                const float b2 = __shfl_sync(0xffffffffu, a2, k);
                const int t = begin + k;
                rp += b0 * first[t], rl += b1 * smooth[t], rpp += b0 * second[t];
                rpl += b1 * first[t], rll += b2 * smooth[t];
            }
        }
        float half = 0.5f * (rpp - rll);
        half = fabsf(half) < LEAST ? 0.0f : half;
        rpl = fabsf(rpl) < LEAST ? 0.0f : rpl;
        const float spread = sqrtf(half * half + rpl * rpl);
        const float least = 0.5f * (rpp + rll) - spread;
        const float tilt = half - spread < 0.0f ? rpl / (half - spread) : 0.0f;
        ++moves;
        if (!(least < 0.0f)) break;
        const float offset = -((rp + rl * tilt) / least);
        if (fabsf(offset) <= OFFSET) {
            const float shorter = 1.0f - offset * offset * curve;
            position = (float)p + offset * shorter;
            strength = scale * -least;
            break;
        }
        const float step = fminf(fmaxf(floorf(offset + 0.5f), -1.0f), 1.0f);
        p = min(max(p + (int)step, 0), size - 1);
    }
    if (lane == 0) positions.data[number] = position, strengths.data[number] = strength;
}
