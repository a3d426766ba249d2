// A bilateral grid on CUDA: a block fills the cells of one place and smooths them along Z; a thread
// reads four pixels of a row.
#include "_sums_cuda.h"

// needs STEPS, SLOTS, DEEPEST
void fill_cells(wp::array_t<float> logs, float lowest, float space, float depth,
                wp::array_t<float> taps, wp::array_t<float> out) {
    enum { WIDE = 64, AHEAD = 4 };  // threads along a row, and values that one reads at once
    // Lower and upper halves of sums, and numbers: atomic sums of 64 bits are slow.
    __shared__ unsigned low[DEEPEST], high[DEEPEST], number[DEEPEST];
    const int height = logs.shape[0], width = logs.shape[1], size = out.shape[2];
    const int row = blockIdx.x / out.shape[1], column = blockIdx.x % out.shape[1];
    for (int i = threadIdx.x; i < size; i += blockDim.x) low[i] = high[i] = number[i] = 0;
    __syncthreads();
    // The rows and the columns of pixels of the cell, at least.
    const int top = max((int)(((float)row - 3.0f) / space), 0);
    const int bottom = min((int)(((float)row - 1.0f) / space), height - 1);
    const int left = max((int)(((float)column - 3.0f) / space), 0);
    const int right = min((int)(((float)column - 1.0f) / space), width - 1);
    for (int x = left + threadIdx.x % WIDE; x <= right; x += WIDE) {
        if ((int)((float)x * space + 2.5f) != column) continue;
        long long total = 0;
        int z = 0, count = 0;
        const auto flush = [&] {
            if (!count) return;
            const unsigned part = (unsigned)total, old = atomicAdd(low + z, part);
            const unsigned more = (unsigned)(total >> 32) + (old + part < old);
            if (more) atomicAdd(high + z, more);
            atomicAdd(number + z, (unsigned)count);
        };
        const int step = blockDim.x / WIDE;
        for (int y = top + threadIdx.x / WIDE; y <= bottom; y += AHEAD * step) {
            float off[AHEAD];
#pragma unroll
            for (int n = 0; n < AHEAD; ++n)
                off[n] = logs.data[(size_t)min(y + n * step, bottom) * width + x] - lowest;
#pragma unroll
            for (int n = 0; n < AHEAD; ++n) {
                const int v = y + n * step;
                if (v > bottom || (int)((float)v * space + 2.5f) != row) continue;
                const int deep = (int)(off[n] * depth + 2.5f);
                if (deep != z) {
                    flush();
                    total = count = 0;
                    z = deep;
                }
                total += __float2int_rd(off[n] * STEPS + 0.5f);  // below 2^29
                ++count;
            }
        }
        flush();
    }
    __syncthreads();
    float* to = out.data + (size_t)blockIdx.x * 2 * size;
    for (int i = threadIdx.x; i < 2 * size; i += blockDim.x) {
        float total = 0.0f;
        for (int t = 0; t < taps.shape[0]; ++t) {
            const int u = i / 2 + t - taps.shape[0] / 2;
            if (u < 0 || u >= size) continue;
            const long long sum = (long long)(((unsigned long long)high[u] << 32) | low[u]);
            total += taps.data[t] * (i % 2 ? (float)(long long)number[u] : (float)sum);
        }
        to[i] = total;
    }
}

// needs STEPS, SLOTS, DEEPEST
void read_four(wp::array_t<float> logs, wp::array_t<float> cells, float lowest, float space,
               float depth, wp::array_t<float> out, wp::array_t<wp::int64> sums) {
    const int height = logs.shape[0], width = logs.shape[1], parts = (width + 3) / 4;
    const int down = cells.shape[1] * cells.shape[2];
    const bool aligned = width % 4 == 0 && (((size_t)logs.data | (size_t)out.data) & 15) == 0;
    const auto between = [](float2 a, float2 b, float f) {
        return make_float2(a.x + f * (b.x - a.x), a.y + f * (b.y - a.y));
    };
    Sums own;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < height * parts;
         i += gridDim.x * blockDim.x) {
        const int row = i / parts, begin = i % parts * 4;
        const size_t start = (size_t)row * width + begin;
        const float y = (float)row * space + 2.0f;
        const float fy = y - (float)(int)y;
        float v[4] = {lowest, lowest, lowest, lowest};
        if (aligned) {
            const float4 four = *(const float4*)(logs.data + start);
            v[0] = four.x;
            v[1] = four.y;
            v[2] = four.z;
            v[3] = four.w;
        } else {
            for (int k = 0; k < 4; ++k)
                if (begin + k < width) v[k] = logs.data[start + k];
        }
        for (int k = 0; k < 4; ++k) {
            // A pixel beyond the row reads the cells of its end, and is not written.
            const int column = begin + k < width ? begin + k : width - 1;
            const float x = (float)column * space + 2.0f, z = (v[k] - lowest) * depth + 2.0f;
            const float fx = x - (float)(int)x, fz = z - (float)(int)z;
            const float2* at = (const float2*)cells.data +
                               ((int)y * cells.shape[1] + (int)x) * cells.shape[2] + (int)z;
            float2 near[2];
            for (int n = 0; n < 2; ++n) {
                const float2* p = at + n * down;
                near[n] = between(between(p[0], p[1], fz),
                                  between(p[cells.shape[2]], p[cells.shape[2] + 1], fz), fx);
            }
            const float2 found = between(near[0], near[1], fy);
            v[k] = lowest + found.x / ((found.y > 1.0e-12f ? found.y : 1.0e-12f) * STEPS);
            if (begin + k < width) own.add(v[k]);
        }
        if (aligned)
            *(float4*)(out.data + start) = make_float4(v[0], v[1], v[2], v[3]);
        else
            for (int k = 0; k < 4; ++k)
                if (begin + k < width) out.data[start + k] = v[k];
    }
    own.share(sums.data);
}
