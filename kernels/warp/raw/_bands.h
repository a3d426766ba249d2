// Levels of pyramids of planes, and the bands of a local Laplacian filter, PART values at once. The
// letters are those of the Taichi set.
#include "_pyramid.h"

// needs PART
void _reduce(int row, int left, int right, wp::array_t<float> src, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int plane = row / dst.shape[1], y = row % dst.shape[1];
    const int height = src.shape[1], width = src.shape[2];
    const float* from = src.data + (size_t)plane * height * width;
    float* to = dst.data + (size_t)row * dst.shape[2];
    const float* rows[5];
    for (int k = 0; k < 5; ++k) rows[k] = from + (size_t)Mirror::at(2 * y - 2 + k, height) * width;
    float line[Pyramid::WIDE];
    for (int begin = left; begin < right; begin += PART) {
        const int count = Pyramid::count(begin, right), first = 2 * begin - 2;
        each_mirrored(first, 2 * count + 3, width, [&](int t, int x) {
            line[t] = Pyramid::weigh(rows[0][x], rows[1][x], rows[2][x], rows[3][x], rows[4][x]);
        });
        for (int i = 0; i < count; ++i)
            if (Pyramid::within(begin + i, right))
                to[begin + i] = Pyramid::weigh(line[2 * i], line[2 * i + 1], line[2 * i + 2],
                                               line[2 * i + 3], line[2 * i + 4]);
    }
}

// needs PART
void _begin(int row, int left, int right, wp::array_t<float> logs, float lowest, float step,
            float sigma, float slope, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int references = dst.shape[0] - 2, height = logs.shape[0], width = logs.shape[1];
    const size_t plane = (size_t)dst.shape[1] * dst.shape[2];
    float* to = dst.data + (size_t)row * dst.shape[2];
    float rows[5][Pyramid::WIDE], line[Pyramid::WIDE];
    for (int begin = left; begin < right; begin += PART) {
        const int count = Pyramid::count(begin, right), first = 2 * begin - 2;
        const int length = 2 * count + 3;
        for (int k = 0; k < 5; ++k) {
            const float* from = logs.data + (size_t)Mirror::at(2 * row - 2 + k, height) * width;
            each_mirrored(first, length, width, [&](int t, int x) { rows[k][t] = from[x]; });
        }
        for (int j = 0; j <= references; ++j) {
            const float about = lowest + (float)j * step;
            const auto remap = [=](float v) {
                const float d = v - about;
                const float near = d < -sigma ? -sigma : d > sigma ? sigma : d;
                return (about + near) + slope * (d - near);
            };
            if (j < references)
                for (int t = 0; t < length; ++t)
                    line[t] =
                        Pyramid::weigh(remap(rows[0][t]), remap(rows[1][t]), remap(rows[2][t]),
                                       remap(rows[3][t]), remap(rows[4][t]));
            else
                for (int t = 0; t < length; ++t)
                    line[t] =
                        Pyramid::weigh(rows[0][t], rows[1][t], rows[2][t], rows[3][t], rows[4][t]);
            for (int i = 0; i < count; ++i)
                if (Pyramid::within(begin + i, right))
                    to[j * plane + begin + i] =
                        Pyramid::weigh(line[2 * i], line[2 * i + 1], line[2 * i + 2],
                                       line[2 * i + 3], line[2 * i + 4]);
        }
    }
}

// needs PART
void _collapse(int row, int left, int right, wp::array_t<float> fine, wp::array_t<float> coarse,
               int below, float share, float lowest, float step, float sigma, float slope,
               wp::array_t<float> out) {
#pragma clang fp contract(off)
    const int height = out.shape[1], width = out.shape[2];
    const int rows = coarse.shape[1], columns = coarse.shape[2], references = coarse.shape[0] - 2;
    const size_t plane = (size_t)height * width, small = (size_t)rows * columns;
    const float* from = fine.data + (size_t)row * width;
    const float* base = from + (fine.shape[0] > 1 ? references : 0) * plane;
    float* to = out.data + (out.shape[0] - 1) * plane + (size_t)row * width;
    const float scale = 1.0f / step;
    float total[PART], place[PART], other[PART];
    for (int begin = left; begin < right; begin += PART) {
        const int count = Pyramid::count(begin, right);
        Pyramid::expand(coarse.data + below * small, rows, columns, height, width, row, begin,
                        count, total);
        float least = (float)references, most = 0.0f;
        for (int i = 0; i < count; ++i) {
            total[i] = share * total[i];
            place[i] =
                ((Pyramid::within(begin + i, right) ? base[begin + i] : lowest) - lowest) * scale;
            least = place[i] < least ? place[i] : least;
            most = place[i] > most ? place[i] : most;
        }
        // References further off have no weight.
        const int last = most + 1.0f < (float)references ? (int)most + 1 : references - 1;
        for (int j = least > 0.0f ? (int)least : 0; j <= last; ++j) {
            const float about = lowest + (float)j * step;
            Pyramid::expand(coarse.data + j * small, rows, columns, height, width, row, begin,
                            count, other);
            const float* own = from + (fine.shape[0] > 1 ? j : 0) * plane + begin;
            for (int i = 0; i < count; ++i) {
                if (!Pyramid::within(begin + i, right)) continue;
                float value = own[i];
                if (sigma > 0.0f) {
                    const float d = value - about;
                    const float near = d < -sigma ? -sigma : d > sigma ? sigma : d;
                    value = (about + near) + slope * (d - near);
                }
                const float off = place[i] - (float)j;
                const float weight = 1.0f - (off < 0.0f ? -off : off);
                total[i] += (weight > 0.0f ? weight : 0.0f) * (value - other[i]);
            }
        }
        for (int i = 0; i < count; ++i)
            if (Pyramid::within(begin + i, right)) to[begin + i] = total[i];
    }
}
