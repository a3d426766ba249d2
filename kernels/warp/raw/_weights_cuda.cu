// Weights of exposures on CUDA, with the sums of _fusion.h in the same order. A pixel has CHANNELS
// values.
#include "_powers.h"
#include "_mirror.h"

// A thread has four pixels of ROWS rows, of one exposure after the other. The weights of the first
// KEPT exposures stay in shared memory until their sum is known. Conversions, divisions and square
// roots take longest: bytes become floats as the lower bits of 2^23, and quotients by one number share
// its reciprocal.
// needs TYPE, SUM, INTEGRAL, CHANNELS, LEAST, BLOCK, KEPT
void weigh_block(wp::array_t<TYPE> frames, float scale, float contrast, float saturation,
                 float exposure, wp::array_t<float> weights) {
    enum { ROWS = 2, QUICK = INTEGRAL && CHANNELS == 3 };
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
    const auto real = [=](TYPE v) {
        return INTEGRAL ? __uint_as_float(0x4b000000u | (unsigned)v) - 8388608.0f : value(v);
    };
    // a / b, rounded as IEEE has it, from the rounded 1 / b [Markstein 1990]. The first correction
    // is right but for a unit in the last place. Neither it nor the operands may underflow.
    const auto quotient = [](float a, float b, float reciprocal) {
        float q = a * reciprocal;
        q = __fmaf_rn(__fmaf_rn(-b, q, a), reciprocal, q);
        return __fmaf_rn(__fmaf_rn(-b, q, a), reciprocal, q);
    };
    __shared__ float4 kept[KEPT][ROWS][BLOCK];
    const auto power = [](float x, float p) {
        if (p == 1.0f) return x;
        return p == 0.0f ? 1.0f : x > 1e-30f ? Powers::exp2(p * Powers::log2(x)) : 0.0f;
    };
    // Bytes and powers of 1, as by default, need no branches: then four pixels of both rows are
    // computed side by side. Roots and reciprocals are those of the compiler for normal numbers.
    struct Plain {
        enum { YES = 1 };
    };
    struct General {
        enum { YES = 0 };
    };
    const bool plain = QUICK && aligned && contrast == 1.0f && saturation == 1.0f && count <= KEPT;
    const auto root = [](float x) {
        float r;
        asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
        const float s = x * r;
        const float better = __fmaf_rn(__fmaf_rn(-s, s, x), 0.5f * r, s);
        return x > 0.0f ? better : 0.0f;
    };
    const auto inverse = [](float x) {
        float r;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
        return __fmaf_rn(__fmaf_rn(-x, r, 1.0f), r, r);
    };
    const auto put = [&](const float4& four, int k, int row, int begin) {
        float* to = weights.data + k * size + (size_t)row * width + begin;
        const float v[4] = {four.x, four.y, four.z, four.w};
        if (width % 4 == 0)
            *(float4*)to = four;
        else
            for (int i = 0; i < 4 && begin + i < width; ++i) to[i] = v[i];
    };
    const auto weigh = [&](auto kind, int k, int top, int begin, const auto& grey,
                           const auto& pixels, auto& total) {
        enum { PLAIN = decltype(kind)::YES };
#pragma unroll
        for (int r = 0; r < ROWS; ++r) {
            if (!PLAIN && top + r >= height) continue;
            float found[4];
            for (int i = 0; i < 4; ++i) {
                // The quotient is exact where all are equal: grey has no saturation.
                const SUM centre = grey[r + 1][i + 1];
                const float own = INTEGRAL
                                      ? __uint_as_float(0x4b000000u | (unsigned)centre) - 8388608.0f
                                      : (float)centre;
                const float mean = CHANNELS == 1 ? own
                                   : INTEGRAL    ? quotient(own, 3.0f, third)
                                                 : own / 3.0f;
                const float here = mean * scale;
                const SUM down = grey[r][i + 1] + grey[r + 2][i + 1];
                const SUM around = down + (SUM)(grey[r + 1][i] + grey[r + 1][i + 2]);
                const SUM bend = around - 4 * centre;
                const float off =
                    INTEGRAL ? __uint_as_float(0x4b000000u | (unsigned)abs((int)bend)) - 8388608.0f
                             : fabsf((float)bend);
                float far = 0.0f, apart = 0.0f;
                for (int c = 0; c < CHANNELS; ++c) {
                    const float v = real(pixels[r + 1].v[i * CHANNELS + c]) * scale;
                    far += (v - 0.5f) * (v - 0.5f);
                    apart += (v - here) * (v - here);
                }
                const float edge = PLAIN ? off * share : power(off * share, contrast);
                const float spread =
                    PLAIN ? root(apart * third)
                          : power(sqrtf(apart * third), CHANNELS == 3 ? saturation : 0.0f);
                found[i] = edge * spread * Powers::exp2(exposure * far) + LEAST;
                total[r][i] += found[i];
            }
            const float4 four = make_float4(found[0], found[1], found[2], found[3]);
            if (PLAIN || k < KEPT)
                kept[k][r][threadIdx.x] = four;
            else
                put(four, k, top + r, begin);
        }
    };
    const auto share_out = [&](auto kind, int top, int begin, const auto& total) {
        enum { PLAIN = decltype(kind)::YES };
#pragma unroll
        for (int r = 0; r < ROWS; ++r) {
            if (top + r >= height) continue;
            float reciprocal[4];
            for (int i = 0; i < 4; ++i) reciprocal[i] = PLAIN ? inverse(total[r][i]) : 0.0f;
            for (int k = 0; k < count; ++k) {
                union {
                    float4 four;
                    float v[4];
                } found;
                const float* from = weights.data + k * size + (size_t)(top + r) * width + begin;
                if (PLAIN || k < KEPT)
                    found.four = kept[k][r][threadIdx.x];
                else
                    for (int i = 0; i < 4; ++i) found.v[i] = begin + i < width ? from[i] : 0.0f;
                for (int i = 0; i < 4; ++i)
                    found.v[i] = PLAIN ? quotient(found.v[i], total[r][i], reciprocal[i])
                                       : found.v[i] / total[r][i];
                put(found.four, k, top + r, begin);
            }
        }
    };
    const int parts = (width + 3) / 4, items = (height + ROWS - 1) / ROWS * parts;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < items;
         item += gridDim.x * blockDim.x) {
        const int top = item / parts * ROWS, begin = item % parts * 4;
        float total[ROWS][4];
        for (int r = 0; r < ROWS; ++r)
            for (int i = 0; i < 4; ++i) total[r][i] = 0.0f;
        for (int k = 0; k < count; ++k) {
            const TYPE* frame = frames.data + k * size * CHANNELS;
            SUM grey[ROWS + 2][6];
            Pixels pixels[ROWS + 2];
            if (QUICK && aligned) {
                // Words of bytes, with a word before and one after. All rows are read before the
                // first of them is used, so that they are waited for once.
                const bool before = begin == 0, beyond = begin + 4 == width;
                unsigned words[ROWS + 2][5];
#pragma unroll
                for (int r = 0; r < ROWS + 2; ++r) {
                    const TYPE* row =
                        frame + (size_t)Mirror::at(top - 1 + r, height) * width * CHANNELS;
                    const unsigned* from = (const unsigned*)(row + begin * CHANNELS);
                    words[r][0] = from[before ? 0 : -1];
#pragma unroll
                    for (int i = 0; i < 3; ++i) words[r][i + 1] = from[i];
                    words[r][4] = from[beyond ? 2 : 3];
                }
#pragma unroll
                for (int r = 0; r < ROWS + 2; ++r) {
                    // Sums of three of the bytes of words.
                    const unsigned a = words[r][1], b = words[r][2], c = words[r][3];
                    unsigned* to = (unsigned*)pixels[r].v;
                    to[0] = a;
                    to[1] = b;
                    to[QUICK ? 2 : 0] = c;
                    grey[r][1] = (SUM)__dp4a(a, 0x00010101u, 0u);
                    grey[r][2] = (SUM)__dp4a(b, 0x00000101u, a >> 24);
                    grey[r][3] = (SUM)__dp4a(b, 0x01010000u, c & 255u);
                    grey[r][4] = (SUM)__dp4a(c, 0x01010100u, 0u);
                    grey[r][0] = before ? grey[r][2] : (SUM)__dp4a(words[r][0], 0x01010100u, 0u);
                    grey[r][5] = beyond ? grey[r][3] : (SUM)__dp4a(words[r][4], 0x00010101u, 0u);
                }
            } else {
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
                    for (int i = 0; i < 4; ++i)
                        grey[r][i + 1] = own_sum(pixels[r].v + i * CHANNELS);
                    grey[r][5] = own_sum(row + Mirror::at(begin + 4, width) * CHANNELS);
                }
            }
            if (plain)
                weigh(Plain(), k, top, begin, grey, pixels, total);
            else
                weigh(General(), k, top, begin, grey, pixels, total);
        }
        if (plain)
            share_out(Plain(), top, begin, total);
        else
            share_out(General(), top, begin, total);
    }
}
