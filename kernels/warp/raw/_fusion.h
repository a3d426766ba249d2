// Weights of exposures, and their bands added up, PART pixels of a row at once. The Taichi set has
// the equations. A pixel has CHANNELS values; planes of a level are these and the weight.
#include "_powers.h"
#include "_pyramid.h"

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void _weigh(int row, int left, int right, wp::array_t<TYPE> frames, float scale, float contrast,
            float saturation, float exposure, wp::array_t<float> weights) {
#pragma clang fp contract(off)
    const int count = frames.shape[0], height = frames.shape[1], width = frames.shape[2];
    const size_t size = (size_t)height * width;
    const float third = 1.0f / 3.0f, share = CHANNELS == 1 ? scale : scale * third;
    SUM grey[3][PART + 2];
    float edge[PART], spread[PART], quality[PART], total[PART];
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
    const auto power = [](float* x, float p, int count) {
        if (p == 1.0f) return;
        for (int i = 0; i < count; ++i)
            x[i] = p == 0.0f ? 1.0f : x[i] > 1e-30f ? Powers::exp2(p * Powers::log2(x[i])) : 0.0f;
    };
    for (int begin = left; begin < right; begin += PART) {
        const int some = Pyramid::count(begin, right);
        for (int i = 0; i < some; ++i) total[i] = 0.0f;
        for (int k = 0; k < count; ++k) {
            const TYPE* frame = frames.data + k * size * CHANNELS;
            for (int r = 0; r < 3; ++r) {
                const TYPE* from =
                    frame + (size_t)Mirror::at(row - 1 + r, height) * width * CHANNELS;
                each_mirrored(begin - 1, some + 2, width,
                              [&](int t, int x) { grey[r][t] = own_sum(from + x * CHANNELS); });
            }
            const TYPE* from = frame + ((size_t)row * width + begin) * CHANNELS;
            for (int i = 0; i < some; ++i) {
                // The quotient is exact where all are equal: grey has no saturation.
                const float own = (float)grey[1][i + 1];
                const float here = (CHANNELS == 1 ? own : own / 3.0f) * scale;
                const SUM down = grey[0][i + 1] + grey[2][i + 1];
                const SUM around = down + (SUM)(grey[1][i] + grey[1][i + 2]);
                const float off = (float)(SUM)(around - 4 * grey[1][i + 1]);
                float far = 0.0f, apart = 0.0f;
                for (int c = 0; c < CHANNELS; ++c) {
                    const int x = Pyramid::within(begin + i, right) ? i : 0;
                    const float v = value(from[x * CHANNELS + c]) * scale;
                    far += (v - 0.5f) * (v - 0.5f);
                    apart += (v - here) * (v - here);
                }
                edge[i] = (off < 0.0f ? -off : off) * share;
                spread[i] = wp::sqrt(apart * third);
                quality[i] = Powers::exp2(exposure * far);
            }
            power(edge, contrast, some);
            power(spread, CHANNELS == 3 ? saturation : 0.0f, some);
            float* to = weights.data + k * size + (size_t)row * width + begin;
            for (int i = 0; i < some; ++i) {
                const float found = edge[i] * spread[i] * quality[i] + LEAST;
                total[i] += found;
                if (Pyramid::within(begin + i, right)) to[i] = found;
            }
        }
        for (int k = 0; k < count; ++k) {
            float* to = weights.data + k * size + (size_t)row * width + begin;
            for (int i = 0; i < some; ++i)
                if (Pyramid::within(begin + i, right)) to[i] = to[i] / total[i];
        }
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void _begin(int row, int left, int right, wp::array_t<TYPE> frames, float scale,
            wp::array_t<float> weights, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int height = frames.shape[1], width = frames.shape[2];
    const int k = row / dst.shape[1], y = row % dst.shape[1];
    const size_t size = (size_t)height * width, small = (size_t)dst.shape[1] * dst.shape[2];
    float* to = dst.data + k * (CHANNELS + 1) * small + (size_t)y * dst.shape[2];
    const TYPE* rows[5];
    const float* shares[5];
    for (int r = 0; r < 5; ++r) {
        const size_t start = k * size + (size_t)Mirror::at(2 * y - 2 + r, height) * width;
        rows[r] = frames.data + start * CHANNELS;
        shares[r] = weights.data + start;
    }
    const auto value = [](TYPE v) {
        const float x = (float)v;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    // Sums of bytes are exact in any order; they are scaled at the end.
    const auto down = [=](int x) {
        if (INTEGRAL)
            return (float)(((int)rows[0][x] + (int)rows[4][x]) +
                           4 * ((int)rows[1][x] + (int)rows[3][x]) + 6 * (int)rows[2][x]);
        return Pyramid::weigh(value(rows[0][x]), value(rows[1][x]), value(rows[2][x]),
                              value(rows[3][x]), value(rows[4][x]));
    };
    const auto share = [=](int x) {
        return Pyramid::weigh(shares[0][x], shares[1][x], shares[2][x], shares[3][x], shares[4][x]);
    };
    const float last = INTEGRAL ? 0.0625f * scale : scale;
    float line[CHANNELS * Pyramid::WIDE], weight[Pyramid::WIDE];
    for (int begin = left; begin < right; begin += PART) {
        const int count = Pyramid::count(begin, right), first = 2 * begin - 2;
        const int length = 2 * count + 3;
        each_mirrored(first, length, width, [&](int t, int x) {
            for (int c = 0; c < CHANNELS; ++c) line[CHANNELS * t + c] = down(CHANNELS * x + c);
        });
        each_mirrored(first, length, width, [&](int t, int x) { weight[t] = share(x); });
        for (int i = 0; i < count; ++i) {
            if (!Pyramid::within(begin + i, right)) continue;
            for (int c = 0; c < CHANNELS; ++c) {
                const float* from = line + 2 * CHANNELS * i + c;
                to[c * small + begin + i] =
                    Pyramid::weigh(from[0], from[CHANNELS], from[2 * CHANNELS], from[3 * CHANNELS],
                                   from[4 * CHANNELS]) *
                    last;
            }
        }
        for (int i = 0; i < count; ++i)
            if (Pyramid::within(begin + i, right))
                to[CHANNELS * small + begin + i] =
                    Pyramid::weigh(weight[2 * i], weight[2 * i + 1], weight[2 * i + 2],
                                   weight[2 * i + 3], weight[2 * i + 4]);
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void _blend(int row, int left, int right, wp::array_t<float> coarse, int alone,
            wp::array_t<float> fine) {
#pragma clang fp contract(off)
    const int height = fine.shape[1], width = fine.shape[2], end = fine.shape[0] - CHANNELS;
    const int count = end / (CHANNELS + 1);
    const int rows = coarse.shape[1], columns = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)rows * columns;
    const size_t start = (size_t)row * width;
    float total[PART], other[PART];
    for (int begin = left; begin < right; begin += PART) {
        const int some = Pyramid::count(begin, right);
        for (int c = 0; c < CHANNELS; ++c) {
            if (alone)
                for (int i = 0; i < some; ++i) total[i] = other[i] = 0.0f;
            else
                Pyramid::expand(coarse.data + (end + c) * small, rows, columns, height, width, row,
                                begin, some, total);
            for (int k = 0; k < count; ++k) {
                const float* from = fine.data + (k * (CHANNELS + 1) + c) * size + start + begin;
                const float* weight =
                    fine.data + (k * (CHANNELS + 1) + CHANNELS) * size + start + begin;
                if (!alone)
                    Pyramid::expand(coarse.data + (k * (CHANNELS + 1) + c) * small, rows, columns,
                                    height, width, row, begin, some, other);
                for (int i = 0; i < some; ++i)
                    if (Pyramid::within(begin + i, right))
                        total[i] += weight[i] * (from[i] - other[i]);
            }
            float* to = fine.data + (end + c) * size + start + begin;
            for (int i = 0; i < some; ++i)
                if (Pyramid::within(begin + i, right)) to[i] = total[i];
        }
    }
}

// needs PART, TYPE, SUM, INTEGRAL, CHANNELS, STEEP, LEAST
void _finish(int row, int left, int right, wp::array_t<TYPE> frames, float scale,
             wp::array_t<float> weights, wp::array_t<float> coarse, int alone,
             wp::array_t<float> out) {
#pragma clang fp contract(off)
    const int height = out.shape[0], width = out.shape[1], count = frames.shape[0];
    const int rows = coarse.shape[1], columns = coarse.shape[2];
    const size_t size = (size_t)height * width, small = (size_t)rows * columns;
    float total[CHANNELS][PART], values[CHANNELS][PART], other[PART];
    const auto value = [=](TYPE v) {
        const float x = (float)v * scale;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    for (int begin = left; begin < right; begin += PART) {
        const int some = Pyramid::count(begin, right);
        const size_t start = (size_t)row * width + begin;
        for (int c = 0; c < CHANNELS; ++c) {
            if (alone)
                for (int i = 0; i < some; ++i) total[c][i] = other[i] = 0.0f;
            else
                Pyramid::expand(coarse.data + (count * (CHANNELS + 1) + c) * small, rows, columns,
                                height, width, row, begin, some, total[c]);
        }
        for (int k = 0; k < count; ++k) {
            const TYPE* from = frames.data + (k * size + start) * CHANNELS;
            const float* weight = weights.data + k * size + start;
            for (int i = 0; i < some; ++i)
                for (int c = 0; c < CHANNELS; ++c)
                    values[c][i] =
                        Pyramid::within(begin + i, right) ? value(from[i * CHANNELS + c]) : 0.0f;
            for (int c = 0; c < CHANNELS; ++c) {
                if (!alone)
                    Pyramid::expand(coarse.data + (k * (CHANNELS + 1) + c) * small, rows, columns,
                                    height, width, row, begin, some, other);
                for (int i = 0; i < some; ++i)
                    if (Pyramid::within(begin + i, right))
                        total[c][i] += weight[i] * (values[c][i] - other[i]);
            }
        }
        for (int c = 0; c < CHANNELS; ++c) {
            // Values near 0 and 1 and beyond are bent, so that no two of them become equal. Most
            // parts have none.
            int bends = 0;
            for (int i = 0; i < some; ++i) {
                const float f = total[c][i], above = 1.0f - f, off = f < above ? f : above;
                bends |= STEEP * off - 1.0f < 0.0f;
            }
            if (!bends) continue;
            for (int i = 0; i < some; ++i) {
                const float f = total[c][i], above = 1.0f - f, off = f < above ? f : above;
                const float power = STEEP * off - 1.0f;
                const float bent = 1.0f / STEEP * Powers::exp2(1.44269504f * power);
                total[c][i] = power < 0.0f ? (f < above ? bent : 1.0f - bent) : f;
            }
        }
        float* to = out.data + start * CHANNELS;
        for (int i = 0; i < some; ++i)
            if (Pyramid::within(begin + i, right))
                for (int c = 0; c < CHANNELS; ++c) to[i * CHANNELS + c] = total[c][i];
    }
}
