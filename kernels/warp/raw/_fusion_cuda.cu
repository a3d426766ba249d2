// Bands of exposures added up on CUDA, with the sums of _fusion.h in the same order. A pixel has
// CHANNELS values; planes of a level are these and the weight.
#include "_powers.h"
#include "_pyramid.h"
#include "_strips_cuda.h"
#include "_shares_cuda.h"

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void blend_four(wp::array_t<float> coarse, int alone, wp::array_t<float> fine) {
    const int height = fine.shape[1], width = fine.shape[2], end = fine.shape[0] - CHANNELS;
    const Shares shares = {end, alone != 0};
    // Levels are small: a thread has one channel, so that there are more of them.
    const int squares = (height + 1) / 2 * ((width + 1) / 2);
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < CHANNELS * squares;
         item += gridDim.x * blockDim.x)
        shares.add(fine.data, coarse.data, item / squares, item % squares, height, width);
}

// All small levels of a channel, in one block: of `count` the last is the smallest.
// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void blend_rest(int count, wp::array_t<float> a, wp::array_t<float> b, wp::array_t<float> c,
                wp::array_t<float> d, wp::array_t<float> e, wp::array_t<float> f,
                wp::array_t<float> g) {
    float* const levels[7] = {a.data, b.data, c.data, d.data, e.data, f.data, g.data};
    if (blockIdx.x >= CHANNELS) return;
#pragma unroll 1
    for (int n = count - 1; n >= 0; --n) {
        int height = a.shape[1], width = a.shape[2];
        for (int i = 0; i < n; ++i) {
            height = (height + 1) / 2;
            width = (width + 1) / 2;
        }
        const Shares shares = {a.shape[0] - CHANNELS, n == count - 1};
        const float* coarse = levels[n == count - 1 ? n : n + 1];
        for (int i = threadIdx.x; i < (height + 1) / 2 * ((width + 1) / 2); i += blockDim.x)
            shares.add(levels[n], coarse, blockIdx.x, i, height, width);
        __syncthreads();
    }
}

// A warp's values of a row lie side by side. They go through shared memory, so that whole sectors
// are written: those of a lane are parts of several.
// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST, WARPS
void finish_four(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights,
                 wp::array_t<float> coarse, int alone, wp::array_t<float> out) {
    // Values of a row of two pixels. Integers stay two in a word until they are used: to take them
    // apart is to wait for them.
    enum { EACH = INTEGRAL ? 2 : 1, WORDS = 2 * CHANNELS / EACH, BITS = 8 * sizeof(TYPE) % 32 };
    const int height = out.shape[0], width = out.shape[1], count = frames.shape[0];
    const int tall = coarse.shape[1], wide = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)tall * wide;
    // Bytes become floats as the lower bits of 2^23: conversions are slow.
    const auto value = [=](const unsigned* words, int i) {
        const unsigned word = words[i / EACH], high = 0x4b000000u;
        const unsigned pick = sizeof(TYPE) == 1 ? 0x7440 + i % 2 : i % 2 ? 0x7432 : 0x7410;
        if (INTEGRAL) return (__uint_as_float(__byte_perm(word, high, pick)) - 8388608.0f) * scale;
        const float x = __uint_as_float(word) * scale;
        return x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    enum { LANES = Strip::LANES, CHUNKS = LANES / 2 * CHANNELS };
    __shared__ float4 shared[WARPS][2 * CHUNKS];
    const int columns = (width + 1) / 2, strips = (columns + LANES - 1) / LANES;
    const int lane = threadIdx.x % 32;
    const bool aligned = width % 2 == 0 && ((size_t)frames.data & (2 * sizeof(TYPE) - 1)) == 0;
    const bool whole = width % 4 == 0 && ((size_t)out.data & 15) == 0;
    float4* chunks = shared[threadIdx.x / 32];
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < (height + 1) / 2 * strips;
         item += gridDim.x * blockDim.x / 32) {
        // Lanes beyond the row do the work of its ends. These and the outer ones write nothing.
        const int y = item / strips, begin = item % strips * LANES, column = begin + lane - 1;
        const int x = column < 0 ? 0 : column < columns ? column : columns - 1;
        const bool mine = lane > 0 && lane <= LANES && column < columns;
        const Square square(y, x, height, width, tall, wide);
        float total[CHANNELS][4] = {};
        if (!alone)
            square.expand_together(coarse.data + count * (CHANNELS + 1) * small, small, CHANNELS,
                                   total);
        for (int k = 0; k < count; ++k) {
            const TYPE* from = frames.data + k * size * CHANNELS;
            float weight[4];
            square.read(weights.data + k * size, weight);
            unsigned own[2][WORDS];
#pragma unroll
            for (int r = 0; r < 2; ++r) {
                const TYPE* row = from + (size_t)square.at[2 * r] * CHANNELS;
                if (aligned) {
#pragma unroll
                    for (int i = 0; i < WORDS; ++i)
                        own[r][i] = !INTEGRAL           ? ((const unsigned*)row)[i]
                                    : sizeof(TYPE) == 1 ? ((const unsigned short*)row)[i]
                                                        : ((const unsigned*)row)[i];
                } else {
                    const TYPE* next = from + (size_t)square.at[2 * r + 1] * CHANNELS;
#pragma unroll
                    for (int i = 0; i < WORDS; ++i) own[r][i] = 0;
#pragma unroll
                    for (int i = 0; i < 2 * CHANNELS; ++i) {
                        const TYPE v = i < CHANNELS ? row[i] : next[i - CHANNELS];
                        own[r][i / EACH] |=
                            INTEGRAL ? (unsigned)v << BITS * (i % EACH) : __float_as_uint((float)v);
                    }
                }
            }
            float other[CHANNELS][4] = {};
            if (!alone)
                square.expand_together(coarse.data + k * (CHANNELS + 1) * small, small, CHANNELS,
                                       other);
#pragma unroll
            for (int c = 0; c < CHANNELS; ++c)
                for (int i = 0; i < 4; ++i)
                    total[c][i] +=
                        weight[i] * (value(own[i / 2], i % 2 * CHANNELS + c) - other[c][i]);
        }
#pragma unroll
        for (int r = 0; r < 2; ++r) {
            if (r && !square.lower) continue;
            float found[2 * CHANNELS];
            bool far = false;
#pragma unroll
            for (int i = 0; i < 2; ++i)
#pragma unroll
                for (int c = 0; c < CHANNELS; ++c) {
                    const float f = found[i * CHANNELS + c] = total[c][2 * r + i];
                    far = far || STEEP * (f < 1.0f - f ? f : 1.0f - f) - 1.0f < 0.0f;
                }
            // Values near 0 and 1 and beyond are bent, so that no two of them become equal.
            if (far) {
#pragma unroll
                for (int i = 0; i < 2 * CHANNELS; ++i) {
                    const float f = found[i], above = 1.0f - f;
                    const float power = STEEP * (f < above ? f : above) - 1.0f;
                    const float bent = 1.0f / STEEP * Powers::exp2(1.44269504f * power);
                    found[i] = power < 0.0f ? (f < above ? bent : 1.0f - bent) : f;
                }
            }
            if (!mine) continue;
            if (whole) {
                float2* to = (float2*)(chunks + r * CHUNKS) + CHANNELS * (lane - 1);
#pragma unroll
                for (int i = 0; i < CHANNELS; ++i)
                    to[i] = make_float2(found[2 * i], found[2 * i + 1]);
            } else {
                float* to = out.data + ((size_t)(2 * y + r) * width + 2 * x) * CHANNELS;
                for (int i = 0; i < (square.right ? 2 : 1) * CHANNELS; ++i) to[i] = found[i];
            }
        }
        if (!whole) continue;
        __syncwarp();
        const int some = min(columns - begin, (int)LANES) * CHANNELS / 2;
#pragma unroll
        for (int k = lane; k < 2 * CHUNKS; k += 32) {
            const int r = k / CHUNKS, at = k % CHUNKS;
            float4* to = (float4*)(out.data + ((size_t)(2 * y + r) * width + 2 * begin) * CHANNELS);
            if (2 * y + r < height && at < some) to[at] = chunks[k];
        }
        __syncwarp();
    }
}
