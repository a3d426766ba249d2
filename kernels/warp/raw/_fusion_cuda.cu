// Fusion of exposures on CUDA, with the sums of _fusion.h in the same order. A pixel has CHANNELS
// values; planes of a level are these and the weight.
#include "_powers.h"
#include "_pyramid.h"
#include "_strips_cuda.h"

// A thread has four pixels of ROWS rows, of one exposure after the other.
// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void weigh_block(wp::array_t<TYPE> frames, float scale, float contrast, float saturation,
                 float exposure, wp::array_t<float> weights) {
    enum { ROWS = 2 };
    struct alignas(4 * sizeof(TYPE)) Pixels {
        TYPE v[4 * CHANNELS];
    };
    const int count = frames.shape[0], height = frames.shape[1], width = frames.shape[2];
    const size_t size = (size_t)height * width;
    const float third = 1.0f / 3.0f, share = CHANNELS == 1 ? scale : scale * third;
    const bool aligned = width % 4 == 0 && ((size_t)frames.data & (4 * sizeof(TYPE) - 1)) == 0;
    const auto value = [](TYPE v) {
        const float x = (float)v;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    // Sums of bytes are integers: where edges cancel, nothing is left.
    const auto own_sum = [=](const TYPE* v) {
        const SUM a = INTEGRAL ? (SUM)v[0] : (SUM)value(v[0]);
        if (CHANNELS == 1) return a;
        const SUM b = INTEGRAL ? (SUM)v[CHANNELS / 2] : (SUM)value(v[CHANNELS / 2]);
        const SUM c = INTEGRAL ? (SUM)v[CHANNELS - 1] : (SUM)value(v[CHANNELS - 1]);
        return (SUM)((SUM)(a + b) + c);
    };
    const auto power = [](float x, float p) {
        if (p == 1.0f) return x;
        return p == 0.0f ? 1.0f : x > 1e-30f ? Powers::exp2(p * Powers::log2(x)) : 0.0f;
    };
    const int parts = (width + 3) / 4, items = (height + ROWS - 1) / ROWS * parts;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < items;
         item += gridDim.x * blockDim.x) {
        const int top = item / parts * ROWS, begin = item % parts * 4;
        const bool whole = begin + 4 <= width;
        float total[ROWS][4];
        for (int r = 0; r < ROWS; ++r)
            for (int i = 0; i < 4; ++i) total[r][i] = 0.0f;
        for (int k = 0; k < count; ++k) {
            const TYPE* frame = frames.data + k * size * CHANNELS;
            SUM grey[ROWS + 2][6];
            Pixels pixels[ROWS + 2];
#pragma unroll
            for (int r = 0; r < ROWS + 2; ++r) {
                const TYPE* row =
                    frame + (size_t)Mirror::at(top - 1 + r, height) * width * CHANNELS;
                if (aligned) {
                    pixels[r] = *(const Pixels*)(row + begin * CHANNELS);
                } else {
                    for (int i = 0; i < 4; ++i)
                        for (int c = 0; c < CHANNELS; ++c)
                            pixels[r].v[i * CHANNELS + c] =
                                row[Mirror::at(begin + i, width) * CHANNELS + c];
                }
                grey[r][0] = own_sum(row + Mirror::at(begin - 1, width) * CHANNELS);
                for (int i = 0; i < 4; ++i) grey[r][i + 1] = own_sum(pixels[r].v + i * CHANNELS);
                grey[r][5] = own_sum(row + Mirror::at(begin + 4, width) * CHANNELS);
            }
#pragma unroll
            for (int r = 0; r < ROWS; ++r) {
                if (top + r >= height) continue;
                float found[4];
                for (int i = 0; i < 4; ++i) {
                    // The quotient is exact where all are equal: grey has no saturation.
                    const SUM centre = grey[r + 1][i + 1];
                    const float own = (float)centre;
                    const float here = (CHANNELS == 1 ? own : own / 3.0f) * scale;
                    const SUM down = grey[r][i + 1] + grey[r + 2][i + 1];
                    const SUM around = down + (SUM)(grey[r + 1][i] + grey[r + 1][i + 2]);
                    const float off = (float)(SUM)(around - 4 * centre);
                    float far = 0.0f, apart = 0.0f;
                    for (int c = 0; c < CHANNELS; ++c) {
                        const float v = value(pixels[r + 1].v[i * CHANNELS + c]) * scale;
                        far += (v - 0.5f) * (v - 0.5f);
                        apart += (v - here) * (v - here);
                    }
                    const float edge = power((off < 0.0f ? -off : off) * share, contrast);
                    const float spread =
                        power(sqrtf(apart * third), CHANNELS == 3 ? saturation : 0.0f);
                    found[i] = edge * spread * Powers::exp2(exposure * far) + LEAST;
                    total[r][i] += found[i];
                }
                float* to = weights.data + k * size + (size_t)(top + r) * width + begin;
                if (whole && width % 4 == 0)
                    *(float4*)to = make_float4(found[0], found[1], found[2], found[3]);
                else
                    for (int i = 0; i < 4; ++i)
                        if (begin + i < width) to[i] = found[i];
            }
        }
        for (int k = 0; k < count; ++k)
            for (int r = 0; r < ROWS; ++r) {
                if (top + r >= height) continue;
                float* to = weights.data + k * size + (size_t)(top + r) * width + begin;
                if (whole && width % 4 == 0) {
                    const float4 v = *(const float4*)to;
                    *(float4*)to = make_float4(v.x / total[r][0], v.y / total[r][1],
                                               v.z / total[r][2], v.w / total[r][3]);
                } else {
                    for (int i = 0; i < 4; ++i)
                        if (begin + i < width) to[i] = to[i] / total[r][i];
                }
            }
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void frame_strips(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights,
                  wp::array_t<float> dst) {
    struct alignas(4 * sizeof(TYPE)) Pixels {
        TYPE v[4 * CHANNELS];
    };
    struct Row {
        Pixels pixels;
        float weights[4];
    };
    const int height = frames.shape[1], width = frames.shape[2];
    const int tall = dst.shape[2], wide = dst.shape[3];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + Strip::ROWS - 1) / Strip::ROWS;
    const bool aligned = width % 4 == 0 && ((size_t)frames.data & (4 * sizeof(TYPE) - 1)) == 0;
    const int lane = threadIdx.x % 32;
    const float last = INTEGRAL ? 0.0625f * scale : scale;
    const auto value = [](TYPE v) {
        const float x = (float)v;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
         item < frames.shape[0] * chunks * strips; item += gridDim.x * blockDim.x / 32) {
        const int k = item / strips / chunks, begin = item / strips % chunks * Strip::ROWS;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1);
        Row rows[2 * Strip::ROWS + 3];
        const auto load = [&](int y, Row& to) {
            const size_t start = ((size_t)k * height + Mirror::at(y, height)) * width;
            const TYPE* row = frames.data + start * CHANNELS;
            if (aligned && column >= 0 && 2 * column + 4 <= width) {
                to.pixels = *(const Pixels*)(row + 2 * column * CHANNELS);
            } else {
                for (int i = 0; i < 4; ++i)
                    for (int n = 0; n < CHANNELS; ++n)
                        to.pixels.v[i * CHANNELS + n] =
                            row[Mirror::at(2 * column + i, width) * CHANNELS + n];
            }
            Strip::load(weights.data + start, 2 * column, width, width % 4 == 0, to.weights);
        };
        // All rows are read before any is used.
#pragma unroll
        for (int r = 0; r < 2 * Strip::ROWS + 3; ++r) load(2 * begin - 2 + r, rows[r]);
#pragma unroll
        for (int r = 0; r < Strip::ROWS; ++r) {
            const int y = begin + r;
            if (y >= tall) break;
            const Row &a = rows[2 * r], &b = rows[2 * r + 1], &c = rows[2 * r + 2],
                      &d = rows[2 * r + 3], &e = rows[2 * r + 4];
            float v[4], out[2];
            float* to = dst.data + ((size_t)k * (CHANNELS + 1) * tall + y) * wide;
#pragma unroll
            for (int n = 0; n < CHANNELS; ++n) {
                for (int i = 0; i < 4; ++i) {
                    const int x = i * CHANNELS + n;
                    const TYPE p = a.pixels.v[x], q = b.pixels.v[x], o = c.pixels.v[x],
                               s = d.pixels.v[x], t = e.pixels.v[x];
                    // Sums of bytes are exact in any order; they are scaled at the end.
                    v[i] = INTEGRAL
                               ? (float)(((int)p + (int)t) + 4 * ((int)q + (int)s) + 6 * (int)o)
                               : Pyramid::weigh(value(p), value(q), value(o), value(s), value(t));
                }
                Strip::across(v, out);
                for (int i = 0; i < 2; ++i) out[i] = out[i] * last;
                Strip::write(out, lane, column, wide, to + (size_t)n * tall * wide);
            }
            for (int i = 0; i < 4; ++i)
                v[i] = Pyramid::weigh(a.weights[i], b.weights[i], c.weights[i], d.weights[i],
                                      e.weights[i]);
            Strip::across(v, out);
            Strip::write(out, lane, column, wide, to + (size_t)CHANNELS * tall * wide);
        }
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void blend_four(wp::array_t<float> fine, wp::array_t<float> coarse, int alone,
                wp::array_t<float> below, wp::array_t<float> out) {
    const int height = out.shape[1], width = out.shape[2], count = fine.shape[0];
    const int tall = coarse.shape[1], wide = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)tall * wide;
    const int columns = (width + 1) / 2, items = (height + 1) / 2 * columns;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < items;
         item += gridDim.x * blockDim.x) {
        const int y = item / columns, x = item % columns;
        const Square square(y, x, height, width, tall, wide);
        const bool right = 2 * x + 1 < width, lower = 2 * y + 1 < height;
        const size_t own = (size_t)(2 * y) * width + 2 * x;
        const size_t at[4] = {own, right ? own + 1 : own, lower ? own + width : own,
                              right && lower ? own + width + 1 : own};
        for (int c = 0; c < CHANNELS; ++c) {
            float total[4] = {0.0f, 0.0f, 0.0f, 0.0f}, other[4] = {0.0f, 0.0f, 0.0f, 0.0f};
            if (!alone) square.expand(below.data + c * small, total);
            for (int k = 0; k < count; ++k) {
                const float* from = fine.data + (k * (CHANNELS + 1) + c) * size;
                const float* weight = fine.data + (k * (CHANNELS + 1) + CHANNELS) * size;
                if (!alone) square.expand(coarse.data + (k * (CHANNELS + 1) + c) * small, other);
                for (int i = 0; i < 4; ++i) total[i] += weight[at[i]] * (from[at[i]] - other[i]);
            }
            float* to = out.data + c * size;
            to[at[0]] = total[0];
            if (right) to[at[1]] = total[1];
            if (lower) to[at[2]] = total[2];
            if (right && lower) to[at[3]] = total[3];
        }
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void finish_four(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights,
                 wp::array_t<float> coarse, int alone, wp::array_t<float> below,
                 wp::array_t<float> out) {
    const int height = out.shape[0], width = out.shape[1], count = frames.shape[0];
    const int tall = coarse.shape[1], wide = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)tall * wide;
    const auto value = [=](TYPE v) {
        const float x = (float)v * scale;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    const int columns = (width + 1) / 2, items = (height + 1) / 2 * columns;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < items;
         item += gridDim.x * blockDim.x) {
        const int y = item / columns, x = item % columns;
        const Square square(y, x, height, width, tall, wide);
        const bool right = 2 * x + 1 < width, lower = 2 * y + 1 < height;
        const size_t own = (size_t)(2 * y) * width + 2 * x;
        const size_t at[4] = {own, right ? own + 1 : own, lower ? own + width : own,
                              right && lower ? own + width + 1 : own};
        float total[CHANNELS][4], other[4] = {0.0f, 0.0f, 0.0f, 0.0f};
#pragma unroll
        for (int c = 0; c < CHANNELS; ++c) {
            for (int i = 0; i < 4; ++i) total[c][i] = 0.0f;
            if (!alone) square.expand(below.data + c * small, total[c]);
        }
        for (int k = 0; k < count; ++k) {
            const TYPE* from = frames.data + k * size * CHANNELS;
            float weight[4];
            for (int i = 0; i < 4; ++i) weight[i] = weights.data[k * size + at[i]];
#pragma unroll
            for (int c = 0; c < CHANNELS; ++c) {
                if (!alone) square.expand(coarse.data + (k * (CHANNELS + 1) + c) * small, other);
                for (int i = 0; i < 4; ++i)
                    total[c][i] += weight[i] * (value(from[at[i] * CHANNELS + c]) - other[i]);
            }
        }
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            if ((i % 2 && !right) || (i / 2 && !lower)) continue;
#pragma unroll
            for (int c = 0; c < CHANNELS; ++c) {
                // Values near 0 and 1 and beyond are bent, so that no two of them become equal.
                const float f = total[c][i], above = 1.0f - f, off = f < above ? f : above;
                const float power = STEEP * off - 1.0f;
                const float bent = 1.0f / STEEP * Powers::exp2(1.44269504f * power);
                out.data[at[i] * CHANNELS + c] =
                    power < 0.0f ? (f < above ? bent : 1.0f - bent) : f;
            }
        }
    }
}
