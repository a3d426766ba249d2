// Menon's demosaicing: a warp goes down a strip of columns, of which each lane has four, and keeps
// the rows that the later steps need. The sums are those of _menon.h, in the same order. A row has
// two samples of a colour and two of green in each lane.

#include "../_mirror.h"

// needs TYPE, INTEGRAL, HIGHEST, RED_ROW, RED_COLUMN, HALO, WARPS
void interpolate_strips(wp::array_t<TYPE> raw, int rows, wp::array_t<TYPE> colours) {
    enum { WIDE = 4 * (32 - 2 * HALO), BEFORE = 16 };  // rows before the first that is written
    struct Two {
        float v[2];
    };
    // Four samples stay as words until they are used: to take them apart is to wait for them.
    struct alignas(4 * sizeof(TYPE)) Samples {
        unsigned v[sizeof(TYPE)];
    };
    struct alignas(4 * sizeof(TYPE)) Colours {
        TYPE v[12];
    };
    // Two rows of a strip go through shared memory, so that whole sectors are written.
    struct alignas(sizeof(TYPE) == 1 ? 8 : 16) Chunk {
        unsigned v[sizeof(TYPE) == 1 ? 2 : 4];
    };
    enum { CHUNKS = WIDE * 3 * sizeof(TYPE) / sizeof(Chunk) };
    __shared__ Chunk shared[WARPS][2][CHUNKS];
    const float third = 1.0f / 3.0f, shift = 8388608.0f;
    const auto real = [=](const Samples& four, int i) {
        const unsigned word = four.v[i * sizeof(TYPE) / 4], high = 0x4b000000u;
        if (!INTEGRAL) return __uint_as_float(word);
        const unsigned pick = sizeof(TYPE) == 1 ? 0x7440 + i : i % 2 ? 0x7432 : 0x7410;
        return __uint_as_float(__byte_perm(word, high, pick)) - shift;
    };
    const auto rounded = [=](float value) {
        if (!INTEGRAL) return (TYPE)value;
        const float within = fminf(fmaxf(value + 0.5f, 0.0f), (float)HIGHEST);
        return (TYPE)__float_as_uint(__fadd_rz(within, shift));
    };
    // Products with powers of 2 are exact, and so are all of integers below: fused or not.
    const auto add = [](float a, float x, float b) {
        return INTEGRAL ? __fmaf_rn(a, x, b) : a * x + b;
    };
    // A sample itself is an integer within the range.
    const auto same = [=](float value) {
        return INTEGRAL ? (TYPE)__float_as_uint(value + shift) : (TYPE)value;
    };
    const auto left = [](const Two& a) { return __shfl_up_sync(0xffffffffu, a.v[1], 1); };
    const auto right = [](const Two& a) { return __shfl_down_sync(0xffffffffu, a.v[0], 1); };
    // The sums of what is before and after each place of the other kind, whose columns are odd or
    // even.
    const auto around = [=](const Two& a, int odd) {
        Two sums;
        if (odd) {
            sums.v[0] = a.v[0] + a.v[1];
            sums.v[1] = a.v[1] + right(a);
        } else {
            sums.v[0] = left(a) + a.v[0];
            sums.v[1] = a.v[0] + a.v[1];
        }
        return sums;
    };
    const int height = raw.shape[0], width = raw.shape[1], lane = threadIdx.x % 32;
    const int strips = (width + WIDE - 1) / WIDE, chunks = (height + rows - 1) / rows;
    const bool aligned =
        width % 4 == 0 && (((size_t)raw.data | (size_t)colours.data) & (4 * sizeof(TYPE) - 1)) == 0;
    const bool whole = aligned && width * 3 * sizeof(TYPE) % sizeof(Chunk) == 0 &&
                       (size_t)colours.data % sizeof(Chunk) == 0;
    auto staged = shared[threadIdx.x / 32];
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < strips * chunks;
         item += gridDim.x * blockDim.x / 32) {
        const int begin = item / strips * rows, x = item % strips * WIDE + 4 * (lane - HALO);
        const int end = begin + rows < height ? begin + rows : height;
        const bool own_lane = lane >= HALO && lane < 32 - HALO;
        // Rows of samples, of changes of the differences along rows, of differences along both,
        // of green and direction, of colours at green samples, of the other colour and refined
        // green at samples of a colour, and of refined colours at green samples.
        Two chroma[9], green[9], down[3], across[3], found[3], own[3], other[3], second[3], fine[3],
            last_own[3], last_other[3];
        // Changes of the differences along both, with those of the lanes beside.
        float change[5][3], turns[3][4];
        int flat[5];
        const auto read = [&](int row) {
            const TYPE* from = raw.data + (size_t)Mirror::at(row, height) * width;
            if (aligned && x >= 0 && x + 4 <= width) return *(const Samples*)(from + x);
            Samples four;
#pragma unroll
            for (int k = 0; k < sizeof(TYPE); ++k) {
                enum { EACH = 4 / sizeof(TYPE), BITS = 8 * sizeof(TYPE) % 32 };
                four.v[k] = 0;
                for (int i = 0; i < EACH; ++i) {
                    const TYPE own = from[Mirror::at(x + k * EACH + i, width)];
                    four.v[k] |= INTEGRAL ? (unsigned)own << BITS * i : __float_as_uint((float)own);
                }
            }
            return four;
        };
        Samples ahead = read(begin - BEFORE + 8);
        const Two none = {{0.0f, 0.0f}};
        for (int k = 0; k < 9; ++k) chroma[k] = green[k] = none;
        for (int k = 0; k < 5; ++k) {
            change[k][0] = change[k][1] = change[k][2] = 0.0f;
            flat[k] = 0;
        }
        for (int k = 0; k < 3; ++k) {
            turns[k][0] = turns[k][1] = turns[k][2] = turns[k][3] = 0.0f;
            down[k] = across[k] = found[k] = own[k] = other[k] = second[k] = fine[k] = last_own[k] =
                last_other[k] = none;
        }
        // Read row y + 8, and find the differences to green in row y + 6 and their changes around
        // row y + 5. `odd` says whether a row of the parity of y has samples of a colour at odd
        // columns.
        const auto advance = [&](int y, int odd) {
            const int even = 1 - odd;
#pragma unroll
            for (int k = 0; k < 8; ++k) {
                chroma[k] = chroma[k + 1];
                green[k] = green[k + 1];
            }
            for (int n = 0; n < 2; ++n) {
                chroma[8].v[n] = real(ahead, 2 * n + odd);
                green[8].v[n] = real(ahead, 2 * n + even);
            }
            ahead = read(y + 9);  // a row before its use
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                flat[k] = flat[k + 1];
                for (int n = 0; n < 3; ++n) change[k][n] = change[k + 1][n];
            }
            for (int k = 0; k < 2; ++k) {
                across[k] = across[k + 1];
                down[k] = down[k + 1];
                for (int n = 0; n < 4; ++n) turns[k][n] = turns[k + 1][n];
            }
            {
                const Two near = around(green[6], odd);
                const float before = left(chroma[6]), after = right(chroma[6]);
                const float far[2] = {before + chroma[6].v[1], chroma[6].v[0] + after};
                for (int n = 0; n < 2; ++n) {
                    const float c = chroma[6].v[n];
                    const float h = add(0.5f, near.v[n], add(-0.25f, far[n], 0.5f * c));
                    const float w = add(0.5f, green[5].v[n] + green[7].v[n],
                                        add(-0.25f, chroma[4].v[n] + chroma[8].v[n], 0.5f * c));
                    across[2].v[n] = c - h;
                    down[2].v[n] = c - w;
                }
                change[4][1] = fabsf(across[2].v[0] - across[2].v[1]);
                change[4][2] = fabsf(across[2].v[1] - right(across[2]));
                change[4][0] = __shfl_up_sync(0xffffffffu, change[4][2], 1);
            }
            // The changes of this row, one above and two above.
            Two after;
            for (int n = 0; n < 2; ++n) after.v[n] = fabsf(down[0].v[n] - down[2].v[n]);
            turns[2][0] = left(after);
            turns[2][1] = after.v[0];
            turns[2][2] = after.v[1];
            turns[2][3] = right(after);
        };
        // Rows before those that the results need are only read.
#pragma unroll 1
        for (int top = begin - BEFORE; top < begin - 8; top += 2) {
#pragma unroll
            for (int u = 0; u < 2; ++u) advance(top + u, (u != RED_ROW) != RED_COLUMN);
        }
#pragma unroll 1
        for (int top = begin - 8; top < end; top += 2) {
#pragma unroll
            for (int u = 0; u < 2; ++u) {
                const int y = top + u, odd = (u != RED_ROW) != RED_COLUMN, even = 1 - odd;
                advance(y, odd);
                // Green and the direction in row y + 4: changes along each, nearer ones more.
                found[0] = found[1];
                found[1] = found[2];
                {
                    const float *a = turns[2], *b = turns[0], *m = turns[1] + odd;
                    flat[4] = 0;
                    for (int n = 0; n < 2; ++n) {
                        float along = change[0][n + 1];
                        along += change[0][n];
                        along += change[1][n + odd];
                        along = add(3.0f, change[2][n + 1], along);
                        along = add(3.0f, change[2][n], along);
                        along += change[3][n + odd];
                        along += change[4][n + 1];
                        along += change[4][n];
                        float upright = a[n];
                        upright += b[n];
                        upright += m[n];
                        upright = add(3.0f, a[n + 1], upright);
                        upright = add(3.0f, b[n + 1], upright);
                        upright += m[n + 1];
                        upright += a[n + 2];
                        upright += b[n + 2];
                        const bool level = upright >= along;
                        flat[4] |= level ? 1 << n : 0;
                        found[2].v[n] = chroma[4].v[n] - (level ? across[0].v[n] : down[0].v[n]);
                    }
                }
                // Colours at green samples of row y + 3, whose parity is the other one.
                for (int k = 0; k < 2; ++k) {
                    own[k] = own[k + 1];
                    other[k] = other[k + 1];
                    second[k] = second[k + 1];
                    fine[k] = fine[k + 1];
                    last_own[k] = last_own[k + 1];
                    last_other[k] = last_other[k + 1];
                }
                {
                    const Two p = around(chroma[3], odd), g = around(found[1], odd);
                    for (int n = 0; n < 2; ++n) {
                        const float c = green[3].v[n];
                        own[2].v[n] = add(-0.5f, g.v[n], add(0.5f, p.v[n], c));
                        other[2].v[n] = add(-0.5f, found[0].v[n] + found[2].v[n],
                                            add(0.5f, chroma[2].v[n] + chroma[4].v[n], c));
                    }
                }
                // The other colour, and refined green, at samples of a colour of row y + 2. In the
                // rows above and below, the two colours change places.
                {
                    const Two o = around(other[1], odd), w = around(own[1], odd);
                    Two less;
                    for (int n = 0; n < 2; ++n) less.v[n] = own[1].v[n] - green[2].v[n];
                    const float l[3] = {odd ? less.v[0] : left(less), odd ? less.v[1] : less.v[0],
                                        odd ? right(less) : less.v[1]};
                    for (int n = 0; n < 2; ++n) {
                        const bool level = flat[2] >> n & 1;
                        const float c = chroma[2].v[n], here = c - found[0].v[n];
                        const float h = add(-0.5f, w.v[n], add(0.5f, o.v[n], c));
                        const float v = add(-0.5f, other[0].v[n] + other[2].v[n],
                                            add(0.5f, own[0].v[n] + own[2].v[n], c));
                        second[2].v[n] = level ? h : v;
                        const float mean_h = (l[n] + here) + l[n + 1];
                        const float mean_v = ((other[0].v[n] - green[1].v[n]) + here) +
                                             (other[2].v[n] - green[3].v[n]);
                        fine[2].v[n] = c + -third * (level ? mean_h : mean_v);
                    }
                }
                // Refined colours at green samples of row y + 1.
                {
                    Two less;
                    for (int n = 0; n < 2; ++n) less.v[n] = chroma[1].v[n] - fine[1].v[n];
                    const Two h = around(less, odd);
                    for (int n = 0; n < 2; ++n) {
                        const float w =
                            (chroma[0].v[n] - fine[0].v[n]) + (chroma[2].v[n] - fine[2].v[n]);
                        last_own[2].v[n] = add(0.5f, h.v[n], green[1].v[n]);
                        last_other[2].v[n] = add(0.5f, w, green[1].v[n]);
                    }
                }
                // The other colour at samples of a colour of row y, refined.
                Two less, third_colour;
                for (int n = 0; n < 2; ++n) less.v[n] = last_other[1].v[n] - last_own[1].v[n];
                const float l[3] = {odd ? less.v[0] : left(less), odd ? less.v[1] : less.v[0],
                                    odd ? right(less) : less.v[1]};
                for (int n = 0; n < 2; ++n) {
                    const bool level = flat[0] >> n & 1;
                    const float c = chroma[0].v[n], here = second[0].v[n] - c;
                    const float h = (l[n] + here) + l[n + 1];
                    const float v = ((last_own[0].v[n] - last_other[0].v[n]) + here) +
                                    (last_own[2].v[n] - last_other[2].v[n]);
                    third_colour.v[n] = c + third * (level ? h : v);
                }
                if (!own_lane || y < begin || y >= end || x >= width) continue;
                Colours result;
                const int first = u == RED_ROW ? 0 : 2, last = 2 - first;
                for (int n = 0; n < 2; ++n) {
                    TYPE* at = result.v + 3 * (2 * n + odd);
                    at[first] = same(chroma[0].v[n]);
                    at[1] = rounded(fine[0].v[n]);
                    at[last] = rounded(third_colour.v[n]);
                    at = result.v + 3 * (2 * n + even);
                    at[first] = rounded(last_own[1].v[n]);
                    at[1] = same(green[0].v[n]);
                    at[last] = rounded(last_other[1].v[n]);
                }
                TYPE* to = colours.data + ((size_t)y * width + x) * 3;
                if (whole)
                    ((Colours*)staged[u])[lane - HALO] = result;
                else if (aligned)
                    *(Colours*)to = result;
                else
                    for (int i = 0; i < 12; ++i)
                        if (x + i / 3 < width) to[i] = result.v[i];
            }
            if (!whole || top < begin) continue;
            __syncwarp();
            const int from = item % strips * WIDE, columns = min(WIDE, width - from);
            const int some = columns * 3 * sizeof(TYPE) / sizeof(Chunk);
#pragma unroll
            for (int k = lane; k < 2 * CHUNKS; k += 32) {
                const int u = k / CHUNKS, at = k % CHUNKS;
                TYPE* to = colours.data + ((size_t)(top + u) * width + from) * 3;
                if (top + u < end && at < some) ((Chunk*)to)[at] = staged[u][at];
            }
            __syncwarp();
        }
    }
}
