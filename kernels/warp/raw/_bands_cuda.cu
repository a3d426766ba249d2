// The levels of _bands.h on CUDA, with the same sums in the same order.
#include "_pyramid.h"
#include "_strips_cuda.h"
#include "_layers_cuda.h"

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
        const auto read = [&](int y) {
            return Strip::load(from + (size_t)Mirror::at(y, height) * width, 2 * column, width,
                               aligned);
        };
        const auto settled = [&](const float4& given) {
            Four four;
            Strip::settle(given, 2 * column, width, aligned, four.v);
            return four;
        };
        const float4 first = read(2 * begin - 2), second = read(2 * begin - 1);
        const float4 third = read(2 * begin);
        float4 next = read(2 * begin + 1), after = read(2 * begin + 2);
        Four a = settled(first), b = settled(second), c = settled(third);
#pragma unroll 1
        for (int y = begin; y < end; ++y) {
            const Four d = settled(next), e = settled(after);
            next = read(2 * y + 3);
            after = read(2 * y + 4);
            float v[4], out[2];
            for (int i = 0; i < 4; ++i)
                v[i] = Pyramid::weigh(a.v[i], b.v[i], c.v[i], d.v[i], e.v[i]);
            Strip::across(v, out);
            Strip::write(out, lane, column, wide, to + (size_t)y * wide);
            a = c;
            b = d;
            c = e;
        }
    }
}

// A warp makes `each` rows of MANY planes at once.
// needs PART, MANY
void begin_strips(wp::array_t<float> logs, float lowest, float step, float sigma, float slope,
                  int each, wp::array_t<float> dst) {
    struct Row {
        float v[MANY][4];
    };
    const int height = logs.shape[0], width = logs.shape[1], references = dst.shape[0] - 2;
    const int tall = dst.shape[1], wide = dst.shape[2];
    const int strips = (wide + Strip::WIDE - 1) / Strip::WIDE;
    const int chunks = (tall + each - 1) / each;
    const int groups = references / MANY + 1;
    const bool aligned = width % 4 == 0 && ((size_t)logs.data & 15) == 0;
    const int lane = threadIdx.x % 32;
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < groups * chunks * strips;
         item += gridDim.x * blockDim.x / 32) {
        const int group = item / strips / chunks, begin = item / strips % chunks * each;
        const int column = 2 * (item % strips * Strip::LANES + lane - 1);
        const int end = begin + each < tall ? begin + each : tall;
        Row a, b, c, d, e;
        float v[4], out[2];
        const auto read = [&](int y) {
            const float* row = logs.data + (size_t)Mirror::at(y, height) * width;
            return Strip::load(row, 2 * column, width, aligned);
        };
        const auto remap = [&](const float4& read, Row& to) {
            float given[4];
            Strip::settle(read, 2 * column, width, aligned, given);
#pragma unroll
            for (int k = 0; k < MANY; ++k) {
                const int j = group * MANY + k;
                const float about = lowest + (float)j * step;
                if (j == references) {  // the image as it is
                    for (int i = 0; i < 4; ++i) to.v[k][i] = given[i];
                    continue;
                }
                for (int i = 0; i < 4; ++i) {
                    const float off = given[i] - about;
                    const float near = fminf(fmaxf(off, -sigma), sigma);
                    to.v[k][i] = (about + near) + slope * (off - near);
                }
            }
        };
        float4 one = read(2 * begin - 2), two = read(2 * begin - 1), three = read(2 * begin);
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

// All small levels of a plane, in one block, which keeps each for the next in shared memory.
// needs PART, REST
void reduce_rest(int planes, int count, wp::array_t<float> src, wp::array_t<float> a,
                 wp::array_t<float> b, wp::array_t<float> c, wp::array_t<float> d,
                 wp::array_t<float> e, wp::array_t<float> f, wp::array_t<float> g) {
    float* const levels[8] = {src.data, a.data, b.data, c.data, d.data, e.data, f.data, g.data};
    __shared__ float large[REST], small[REST];
    for (int plane = blockIdx.x; plane < planes; plane += gridDim.x) {
        int height = src.shape[1], width = src.shape[2];
#pragma unroll 1
        for (int n = 0; n < count; ++n) {
            const int tall = (height + 1) / 2, wide = (width + 1) / 2;
            float *kept = n % 2 ? small : large, *before = n % 2 ? large : small;
            const float* from = n ? before : src.data + (size_t)plane * height * width;
            float* to = levels[n + 1] + (size_t)plane * tall * wide;
            for (int i = threadIdx.x; i < tall * wide; i += blockDim.x) {
                const int y = i / wide, x = i % wide;
                int rows[5];
                float line[5];
#pragma unroll
                for (int k = 0; k < 5; ++k) rows[k] = Mirror::at(2 * y - 2 + k, height) * width;
#pragma unroll
                for (int k = 0; k < 5; ++k) {
                    const float* at = from + Mirror::at(2 * x - 2 + k, width);
                    line[k] = Pyramid::weigh(at[rows[0]], at[rows[1]], at[rows[2]], at[rows[3]],
                                             at[rows[4]]);
                }
                to[i] = kept[i] = Pyramid::weigh(line[0], line[1], line[2], line[3], line[4]);
            }
            __syncthreads();
            height = tall;
            width = wide;
        }
    }
}

// needs PART
void collapse_four(wp::array_t<float> fine, wp::array_t<float> coarse, int below, float share,
                   float lowest, float step, float sigma, float slope, wp::array_t<float> out) {
    const int height = out.shape[1], width = out.shape[2], references = coarse.shape[0] - 2;
    const Bands bands = {lowest, step, sigma, slope, references, fine.shape[0] == 1};
    float* to = out.data + (size_t)(out.shape[0] - 1) * height * width;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x;
         item < (height + 1) / 2 * ((width + 1) / 2); item += gridDim.x * blockDim.x)
        bands.add(fine.data, coarse.data, below, share, item, height, width, to);
}

// All small levels, in one block: of `count` the last is the smallest, and adds to nothing.
// needs PART
void collapse_rest(int count, float lowest, float step, float slope, wp::array_t<float> a,
                   wp::array_t<float> b, wp::array_t<float> c, wp::array_t<float> d,
                   wp::array_t<float> e, wp::array_t<float> f, wp::array_t<float> g,
                   wp::array_t<float> h) {
    float* const levels[8] = {a.data, b.data, c.data, d.data, e.data, f.data, g.data, h.data};
    const int references = a.shape[0] - 2;
    const Bands bands = {lowest, step, 0.0f, slope, references, false};
    if (blockIdx.x) return;
#pragma unroll 1
    for (int n = count - 2; n >= 0; --n) {
        int height = a.shape[1], width = a.shape[2];
        for (int i = 0; i < n; ++i) {
            height = (height + 1) / 2;
            width = (width + 1) / 2;
        }
        const int first = n == count - 2;
        const int below = first ? references : references + 1;
        float* to = levels[n] + (size_t)(references + 1) * height * width;
        for (int i = threadIdx.x; i < (height + 1) / 2 * ((width + 1) / 2); i += blockDim.x)
            bands.add(levels[n], levels[n + 1], below, first ? slope : 1.0f, i, height, width, to);
        __syncthreads();
    }
}
