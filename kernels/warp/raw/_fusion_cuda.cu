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
    for (int item = blockIdx.x * blockDim.x + threadIdx.x;
         item < (height + 1) / 2 * ((width + 1) / 2); item += gridDim.x * blockDim.x)
        for (int c = 0; c < CHANNELS; ++c)
            shares.add(fine.data, coarse.data, c, item, height, width);
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

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void finish_four(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights,
                 wp::array_t<float> coarse, int alone, wp::array_t<float> out) {
    struct alignas(2 * sizeof(TYPE)) Two {
        TYPE v[2];
    };
    const int height = out.shape[0], width = out.shape[1], count = frames.shape[0];
    const int tall = coarse.shape[1], wide = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)tall * wide;
    const auto value = [=](TYPE v) {
        const float x = (float)v * scale;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    const int columns = (width + 1) / 2;
    const bool aligned = width % 2 == 0 && ((size_t)frames.data & (2 * sizeof(TYPE) - 1)) == 0 &&
                         ((size_t)out.data & 7) == 0;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < (height + 1) / 2 * columns;
         item += gridDim.x * blockDim.x) {
        const int y = item / columns, x = item % columns;
        const Square square(y, x, height, width, tall, wide);
        float total[CHANNELS][4], other[4] = {0.0f, 0.0f, 0.0f, 0.0f};
#pragma unroll
        for (int c = 0; c < CHANNELS; ++c) {
            for (int i = 0; i < 4; ++i) total[c][i] = 0.0f;
            if (!alone) square.expand(coarse.data + (count * (CHANNELS + 1) + c) * small, total[c]);
        }
        for (int k = 0; k < count; ++k) {
            const TYPE* from = frames.data + k * size * CHANNELS;
            float weight[4];
            square.read(weights.data + k * size, weight);
            TYPE own[2][2 * CHANNELS];
#pragma unroll
            for (int r = 0; r < 2; ++r) {
                const TYPE* row = from + (size_t)square.at[2 * r] * CHANNELS;
                if (aligned) {
#pragma unroll
                    for (int i = 0; i < CHANNELS; ++i) {
                        const Two two = ((const Two*)row)[i];
                        own[r][2 * i] = two.v[0];
                        own[r][2 * i + 1] = two.v[1];
                    }
                } else {
                    const TYPE* next = from + (size_t)square.at[2 * r + 1] * CHANNELS;
#pragma unroll
                    for (int i = 0; i < CHANNELS; ++i) {
                        own[r][i] = row[i];
                        own[r][CHANNELS + i] = next[i];
                    }
                }
            }
#pragma unroll
            for (int c = 0; c < CHANNELS; ++c) {
                if (!alone) square.expand(coarse.data + (k * (CHANNELS + 1) + c) * small, other);
                for (int i = 0; i < 4; ++i)
                    total[c][i] += weight[i] * (value(own[i / 2][i % 2 * CHANNELS + c]) - other[i]);
            }
        }
#pragma unroll
        for (int r = 0; r < 2; ++r) {
            if (r && !square.lower) continue;
            union {
                float v[2 * CHANNELS];
                float2 pairs[CHANNELS];
            } found;
#pragma unroll
            for (int i = 0; i < 2; ++i)
#pragma unroll
                for (int c = 0; c < CHANNELS; ++c) {
                    // Values near 0 and 1 and beyond are bent, so that no two of them become equal.
                    const float f = total[c][2 * r + i], above = 1.0f - f;
                    const float power = STEEP * (f < above ? f : above) - 1.0f;
                    const float bent = 1.0f / STEEP * Powers::exp2(1.44269504f * power);
                    found.v[i * CHANNELS + c] = power < 0.0f ? (f < above ? bent : 1.0f - bent) : f;
                }
            float* to = out.data + ((size_t)(2 * y + r) * width + 2 * x) * CHANNELS;
            if (aligned) {
#pragma unroll
                for (int i = 0; i < CHANNELS; ++i) ((float2*)to)[i] = found.pairs[i];
            } else {
                for (int i = 0; i < (square.right ? 2 : 1) * CHANNELS; ++i) to[i] = found.v[i];
            }
        }
    }
}
