// The first smaller level of exposures and their weights on CUDA, with the sums of _fusion.h in the
// same order. A pixel has CHANNELS values; planes of a level are these and the weight.
#include "_pyramid.h"
#include "_strips_cuda.h"

// The next smaller level of bytes, in rows of whole groups of four pixels. Sums of bytes are exact
// in any order, and one of 5 x 5 has 16 bits: two are in one integer, red and green of a pixel, and
// the last channel of two. They are scaled at the end.
// needs PART, TYPE, INTEGRAL, CHANNELS
void byte_strips(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights, int each,
                 wp::array_t<float> dst) {
    enum { PAIRS = CHANNELS == 3 ? 4 : 0, WORDS = PAIRS + 2 };  // at last, pixels 0 and 2, 1 and 3
    struct Given {
        unsigned words[CHANNELS];
        float4 weights;
    };
    struct Row {
        unsigned sums[WORDS];
        float weights[4];
    };
    const int height = frames.shape[1], width = frames.shape[2];
    const int tall = dst.shape[1], wide = dst.shape[2];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + each - 1) / each;
    const int lane = threadIdx.x % 32;
    const float last = 0.00390625f * scale;
    const auto apart = [](const Given& given) {
        const unsigned* w = given.words;
        Row row;
        if (CHANNELS == 3) {
            row.sums[0] = __byte_perm(w[0], 0, 0x4140);
            row.sums[1] = __byte_perm(w[0], w[1 % CHANNELS], 0x0403) & 0xff00ff;
            row.sums[2] = __byte_perm(w[1 % CHANNELS], 0, 0x4342);
            row.sums[3] = __byte_perm(w[2 % CHANNELS], 0, 0x4241);
            row.sums[PAIRS] = __byte_perm(w[0], w[2 % CHANNELS], 0x0402) & 0xff00ff;
            row.sums[PAIRS + 1] = __byte_perm(w[1 % CHANNELS], w[2 % CHANNELS], 0x0701) & 0xff00ff;
        } else {
            row.sums[0] = w[0] & 0xff00ff;
            row.sums[1] = w[0] >> 8 & 0xff00ff;
        }
        row.weights[0] = given.weights.x;
        row.weights[1] = given.weights.y;
        row.weights[2] = given.weights.z;
        row.weights[3] = given.weights.w;
        return row;
    };
    const auto weigh = [](unsigned a, unsigned b, unsigned c, unsigned d, unsigned e) {
        return a + e + 4 * (b + d) + 6 * c;
    };
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
         item < frames.shape[0] * chunks * strips; item += gridDim.x * blockDim.x / 32) {
        const int k = item / strips / chunks, begin = item / strips % chunks * each;
        const int end = begin + each < tall ? begin + each : tall;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1), first = 2 * column;
        const int at = first < 0 ? 0 : first + 4 > width ? width - 4 : first;
        const auto read = [&](int y) {
            const size_t start = ((size_t)k * height + Mirror::at(y, height)) * width + at;
            const unsigned* words = (const unsigned*)(frames.data + start * CHANNELS);
            Given given;
#pragma unroll
            for (int i = 0; i < CHANNELS; ++i) given.words[i] = words[i];
            given.weights = *(const float4*)(weights.data + start);
            return given;
        };
        Row a = apart(read(2 * begin - 2)), b = apart(read(2 * begin - 1)),
            c = apart(read(2 * begin));
        Given next = read(2 * begin + 1), after = read(2 * begin + 2);
#pragma unroll 1
        for (int y = begin; y < end; ++y) {
            const Row d = apart(next), e = apart(after);
            next = read(2 * y + 3);  // ahead of their use
            after = read(2 * y + 4);
            unsigned v[WORDS];
            float w[4], out[2];
#pragma unroll
            for (int i = 0; i < WORDS; ++i)
                v[i] = weigh(a.sums[i], b.sums[i], c.sums[i], d.sums[i], e.sums[i]);
            for (int i = 0; i < 4; ++i)
                w[i] = Pyramid::weigh(a.weights[i], b.weights[i], c.weights[i], d.weights[i],
                                      e.weights[i]);
            // Two pixels before a border are used, and one after it.
            const bool before = first < 0, beyond = first >= width;
            unsigned one = v[PAIRS], two = v[PAIRS + 1];
            if (before) {
                if (CHANNELS == 3) v[3 % WORDS] = v[1];
                two = __byte_perm(two, 0, 0x1010);
                w[3] = w[1];
            }
            if (beyond) {
                if (CHANNELS == 3) v[0] = v[2 % WORDS];
                one = __byte_perm(one, 0, 0x3232);
                w[0] = w[2];
            }
            float* to = dst.data + ((size_t)k * (CHANNELS + 1) * tall + y) * wide;
            const size_t plane = (size_t)tall * wide;
            if (CHANNELS == 3) {
                const unsigned p = __shfl_up_sync(0xffffffffu, v[2 % WORDS], 1);
                const unsigned q = __shfl_up_sync(0xffffffffu, v[3 % WORDS], 1);
                const unsigned n = __shfl_down_sync(0xffffffffu, v[0], 1);
                const unsigned left = weigh(p, q, v[0], v[1], v[2 % WORDS]);
                const unsigned right = weigh(v[0], v[1], v[2 % WORDS], v[3 % WORDS], n);
                out[0] = (float)(left & 0xffff) * last;
                out[1] = (float)(right & 0xffff) * last;
                Strip::write(out, lane, column, wide, to);
                out[0] = (float)(left >> 16) * last;
                out[1] = (float)(right >> 16) * last;
                Strip::write(out, lane, column, wide, to + plane);
            }
            const unsigned p = __shfl_up_sync(0xffffffffu, one, 1);
            const unsigned q = __shfl_up_sync(0xffffffffu, two, 1);
            const unsigned n = __shfl_down_sync(0xffffffffu, one, 1);
            const unsigned both = weigh(__byte_perm(p, one, 0x5432), __byte_perm(q, two, 0x5432),
                                        one, two, __byte_perm(one, n, 0x5432));
            out[0] = (float)(both & 0xffff) * last;
            out[1] = (float)(both >> 16) * last;
            Strip::write(out, lane, column, wide, to + (CHANNELS - 1) * plane);
            Strip::across(w, out);
            Strip::write(out, lane, column, wide, to + CHANNELS * plane);
            a = c;
            b = d;
            c = e;
        }
    }
}

// The next smaller level of other frames.
// needs PART, TYPE, INTEGRAL, CHANNELS
void frame_strips(wp::array_t<TYPE> frames, float scale, wp::array_t<float> weights, int each,
                  wp::array_t<float> dst) {
    struct alignas(4 * sizeof(TYPE)) Pixels {
        TYPE v[4 * CHANNELS];
    };
    struct Row {
        Pixels pixels;
        float weights[4];
    };
    const int height = frames.shape[1], width = frames.shape[2];
    const int tall = dst.shape[1], wide = dst.shape[2];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + each - 1) / each;
    const bool aligned = width % 4 == 0 && ((size_t)frames.data & (4 * sizeof(TYPE) - 1)) == 0;
    const int lane = threadIdx.x % 32;
    const float last = INTEGRAL ? 0.0625f * scale : scale;
    const auto value = [](TYPE v) {
        const float x = (float)v;
        return INTEGRAL ? x : x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f;
    };
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
         item < frames.shape[0] * chunks * strips; item += gridDim.x * blockDim.x / 32) {
        const int k = item / strips / chunks, begin = item / strips % chunks * each;
        const int end = begin + each < tall ? begin + each : tall;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1);
        Row a, b, c, d, e;
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
            const bool whole = width % 4 == 0;
            Strip::settle(Strip::load(weights.data + start, 2 * column, width, whole), 2 * column,
                          width, whole, to.weights);
        };
        load(2 * begin - 2, a);
        load(2 * begin - 1, b);
        load(2 * begin, c);
#pragma unroll 1
        for (int y = begin; y < end; ++y) {
            load(2 * y + 1, d);
            load(2 * y + 2, e);
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
            a = c;
            b = d;
            c = e;
        }
    }
}
