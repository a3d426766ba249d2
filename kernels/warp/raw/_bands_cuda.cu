// The levels of _bands.h on CUDA, with the same sums in the same order.
#include "_pyramid.h"
#include "_strips_cuda.h"

// A warp makes `each` rows, one after the other, and reads the next two while it adds up.
// needs PART
void reduce_strips(int planes, wp::array_t<float> src, int each, wp::array_t<float> dst) {
    struct Four {
        float v[4];
    };
    const int height = src.shape[1], width = src.shape[2];
    const int tall = dst.shape[1], wide = dst.shape[2];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + each - 1) / each;
    const bool aligned = width % 4 == 0 && ((size_t)src.data & 15) == 0;
    const int lane = threadIdx.x % 32;
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < planes * chunks * strips;
         item += gridDim.x * blockDim.x / 32) {
        const int plane = item / strips / chunks, begin = item / strips % chunks * each;
        const int end = begin + each < tall ? begin + each : tall;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1);
        const float* from = src.data + (size_t)plane * height * width;
        float* to = dst.data + (size_t)plane * tall * wide;
        const auto load = [&](int y) {
            Four four;
            Strip::load(from + (size_t)Mirror::at(y, height) * width, 2 * column, width, aligned,
                        four.v);
            return four;
        };
        Four a = load(2 * begin - 2), b = load(2 * begin - 1), c = load(2 * begin);
        Four d = load(2 * begin + 1), e = load(2 * begin + 2);
#pragma unroll 1
        for (int y = begin; y < end; ++y) {
            const Four next = load(2 * y + 3), after = load(2 * y + 4);
            float v[4], out[2];
            for (int i = 0; i < 4; ++i)
                v[i] = Pyramid::weigh(a.v[i], b.v[i], c.v[i], d.v[i], e.v[i]);
            Strip::across(v, out);
            Strip::write(out, lane, column, wide, to + (size_t)y * wide);
            a = c;
            b = d;
            c = e;
            d = next;
            e = after;
        }
    }
}

// A warp makes LONG rows of MANY planes at once.
// needs PART, MANY, LONG
void begin_strips(wp::array_t<float> logs, float lowest, float step, float sigma, float slope,
                  wp::array_t<float> dst) {
    struct Row {
        float v[MANY][4];
    };
    const int height = logs.shape[0], width = logs.shape[1], references = dst.shape[0] - 2;
    const int tall = dst.shape[1], wide = dst.shape[2];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + LONG - 1) / LONG;
    const int groups = references / MANY + 1;
    const bool aligned = width % 4 == 0 && ((size_t)logs.data & 15) == 0;
    const int lane = threadIdx.x % 32;
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < groups * chunks * strips;
         item += gridDim.x * blockDim.x / 32) {
        const int group = item / strips / chunks, begin = item / strips % chunks * LONG;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1);
        const int end = begin + LONG < tall ? begin + LONG : tall;
        Row a, b, c, d, e;
        float v[4], out[2];
        struct Four {
            float v[4];
        };
        const auto read = [&](int y) {
            Four given;
            const float* row = logs.data + (size_t)Mirror::at(y, height) * width;
            Strip::load(row, 2 * column, width, aligned, given.v);
            return given;
        };
        const auto remap = [&](const Four& given, Row& to) {
#pragma unroll
            for (int k = 0; k < MANY; ++k) {
                const int j = group * MANY + k;
                const float about = lowest + (float)j * step;
                if (j == references) {  // the image as it is
                    for (int i = 0; i < 4; ++i) to.v[k][i] = given.v[i];
                    continue;
                }
                for (int i = 0; i < 4; ++i) {
                    const float off = given.v[i] - about;
                    const float near = fminf(fmaxf(off, -sigma), sigma);
                    to.v[k][i] = (about + near) + slope * (off - near);
                }
            }
        };
        Four one = read(2 * begin - 2), two = read(2 * begin - 1), three = read(2 * begin);
        remap(one, a);
        remap(two, b);
        remap(three, c);
        one = read(2 * begin + 1);
        two = read(2 * begin + 2);
        for (int y = begin; y < end; ++y) {
            remap(one, d);
            remap(two, e);
            one = read(2 * y + 3);  // ahead of their use
            two = read(2 * y + 4);
#pragma unroll
            for (int k = 0; k < MANY; ++k) {
                const int j = group * MANY + k;
                for (int i = 0; i < 4; ++i) {
                    v[i] = Pyramid::weigh(a.v[k][i], b.v[k][i], c.v[k][i], d.v[k][i], e.v[k][i]);
                }

                Strip::across(v, out);
                if (j <= references)
                    Strip::write(out, lane, column, wide, dst.data + ((size_t)j * tall + y) * wide);
            }
            a = c;
            b = d;
            c = e;
        }
    }
}

// needs PART
void collapse_four(wp::array_t<float> fine, wp::array_t<float> coarse, int below, float share,
                   float lowest, float step, float sigma, float slope, wp::array_t<float> out) {
    const int height = out.shape[1], width = out.shape[2];
    const int tall = coarse.shape[1], wide = coarse.shape[2], references = coarse.shape[0] - 2;
    const size_t plane = (size_t)height * width, small = (size_t)tall * wide;
    const bool single = fine.shape[0] == 1;
    const float* base = fine.data + (single ? 0 : references) * plane;
    float* to = out.data + (out.shape[0] - 1) * plane;
    const float scale = 1.0f / step;
    const int columns = (width + 1) / 2, items = (height + 1) / 2 * columns;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < items;
         item += gridDim.x * blockDim.x) {
        const int y = item / columns, x = item % columns;
        const Square square(y, x, height, width, tall, wide);
        float total[4], place[4], other[4], own[4], least = (float)references, most = 0.0f;
        square.expand(coarse.data + below * small, total);
        square.read(base, own);
        for (int i = 0; i < 4; ++i) {
            total[i] = share * total[i];
            place[i] = (own[i] - lowest) * scale;
            least = fminf(least, place[i]);
            most = fmaxf(most, place[i]);
        }
        // References further off have no weight.
        const int last = most + 1.0f < (float)references ? (int)most + 1 : references - 1;
        for (int j = least > 0.0f ? (int)least : 0; j <= last; ++j) {
            float weight[4], any = 0.0f;
            for (int i = 0; i < 4; ++i) {
                const float off = place[i] - (float)j;
                weight[i] = fmaxf(1.0f - fabsf(off), 0.0f);
                any = fmaxf(any, weight[i]);
            }
            if (!(any > 0.0f)) continue;
            const float about = lowest + (float)j * step;
            if (!single) square.read(fine.data + j * plane, own);
            square.expand(coarse.data + j * small, other);
            for (int i = 0; i < 4; ++i) {
                float value = own[i];
                if (sigma > 0.0f) {
                    const float off = value - about;
                    const float near = fminf(fmaxf(off, -sigma), sigma);
                    value = (about + near) + slope * (off - near);
                }
                total[i] += weight[i] * (value - other[i]);
            }
        }
        square.write(total, to);
    }
}
