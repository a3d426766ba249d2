// Fixed filters of 5 x 5 samples: a thread does PART pixels of ROWS rows, so that it reads each row
// once. Both are even. Rows and columns beyond the image are those mirrored at its border. The sums
// are those of _linear.h, in the same order.

#include "../_mirror.h"

// needs TYPE, INTEGRAL, HIGHEST, SHARP, RED_ROW, RED_COLUMN, PART, ROWS, WARPS
void interpolate_block(wp::array_t<TYPE> raw, wp::array_t<TYPE> colours) {
    struct alignas(sizeof(TYPE) * PART > 16 ? 16 : sizeof(TYPE) * PART) Samples {
        TYPE v[PART];
    };
    struct alignas(sizeof(TYPE) * 2) Pair {
        TYPE v[2];
    };
    struct alignas(sizeof(Samples) > 16 ? 16 : sizeof(Samples)) Colours {
        TYPE v[3 * PART];
    };
    // Integers become floats and back as the lower bits of 2^23 and more: conversions are slow.
    const float shift = 8388608.0f;
    const auto real = [=](TYPE v) {
        return INTEGRAL ? __uint_as_float(0x4b000000u | (unsigned)v) - shift : (float)v;
    };
    // Sums of integers are exact in any order, fused or not.
    const auto add = [](float a, float x, float b) {
        return INTEGRAL ? __fmaf_rn(a, x, b) : a * x + b;
    };
    const auto rounded = [=](float share, float sum) {
        if (!INTEGRAL) return (TYPE)(share * sum);
        const float within = fminf(fmaxf(add(share, sum, 0.5f), 0.0f), (float)HIGHEST);
        return (TYPE)__float_as_uint(__fadd_rz(within, shift));
    };
    // A sample itself is an integer within the range.
    const auto same = [=](float value) {
        return INTEGRAL ? (TYPE)__float_as_uint(value + shift) : (TYPE)value;
    };
    // A warp's colours of a row lie side by side. They go through shared memory, so that whole
    // sectors are written: those of a lane are parts of several.
    enum { CHUNKS = 32 * sizeof(Colours) / 16 };
    __shared__ uint4 shared[WARPS][ROWS * CHUNKS];
    const int height = raw.shape[0], width = raw.shape[1], lane = threadIdx.x % 32;
    const unsigned strips = (width + 32 * PART - 1) / (32 * PART);
    const unsigned items = (height + ROWS - 1) / ROWS * strips;
    const bool aligned = (((size_t)raw.data | (size_t)colours.data) & 15) == 0 && width % PART == 0;
    const bool whole = aligned && width * 3 * sizeof(TYPE) % 16 == 0;
    uint4* chunks = shared[threadIdx.x / 32];
    for (unsigned item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < items;
         item += gridDim.x * blockDim.x / 32) {
        const int top = item / strips * ROWS, left = item % strips * 32 * PART;
        const int begin = left + lane * PART;
        float near[ROWS + 4][PART + 4];
        if (aligned) {
            // All rows are read before the first of them is used, so that they are waited for once.
            // A lane beyond the row reads its end, and writes nothing.
            Samples middle[ROWS + 4];
            Pair before[ROWS + 4], after[ROWS + 4];
            const int at = begin < width ? begin : width - PART;
            const bool first = at == 0, last = at + PART == width;
            const int west = first ? 0 : at - 2, east = last ? at : at + PART;
            const bool inner = top >= 2 && top + ROWS + 2 <= height;
#pragma unroll
            for (int k = 0; k < ROWS + 4; ++k) {
                const int row = top + k - 2;
                const TYPE* from =
                    raw.data + (size_t)(inner ? row : Mirror::at(row, height)) * width;
                middle[k] = *(const Samples*)(from + at);
                before[k] = *(const Pair*)(from + west);
                after[k] = *(const Pair*)(from + east);
            }
#pragma unroll
            for (int k = 0; k < ROWS + 4; ++k) {
#pragma unroll
                for (int i = 0; i < 2; ++i) {
                    near[k][i] = real(before[k].v[i]);
                    near[k][PART + 2 + i] = real(after[k].v[i]);
                }
#pragma unroll
                for (int i = 0; i < PART; ++i) near[k][i + 2] = real(middle[k].v[i]);
            }
            if (first) {
#pragma unroll
                for (int k = 0; k < ROWS + 4; ++k) near[k][0] = near[k][4], near[k][1] = near[k][3];
            }
            if (last) {
#pragma unroll
                for (int k = 0; k < ROWS + 4; ++k)
                    near[k][PART + 2] = near[k][PART], near[k][PART + 3] = near[k][PART - 1];
            }
        } else {
            int at[PART + 4];
#pragma unroll
            for (int i = 0; i < PART + 4; ++i) at[i] = Mirror::at(begin + i - 2, width);
#pragma unroll
            for (int k = 0; k < ROWS + 4; ++k) {
                const TYPE* from = raw.data + (size_t)Mirror::at(top + k - 2, height) * width;
#pragma unroll
                for (int i = 0; i < PART + 4; ++i) near[k][i] = real(from[at[i]]);
            }
        }
#pragma unroll
        for (int r = 0; r < ROWS; ++r) {
            if (top + r >= height) break;
            const bool blue = (r & 1) != RED_ROW;  // whether it is a row of blue and green
            const int column = blue ? 1 - RED_COLUMN : RED_COLUMN;
            Colours found;
#pragma unroll
            for (int i = 0; i < PART; ++i) {
                const float* n[5] = {near[r] + i, near[r + 1] + i, near[r + 2] + i, near[r + 3] + i,
                                     near[r + 4] + i};
                const float c = n[2][2], h = n[2][1] + n[2][3], v = n[1][2] + n[3][2];
                const float d = (n[1][1] + n[1][3]) + (n[3][1] + n[3][3]);
                const float far_h = n[2][0] + n[2][4], far_v = n[0][2] + n[4][2];
                const float all = h + v;
                float cross = all, across = h, down = v, corners = d;
                if (SHARP) {
                    const float far = far_h + far_v;
                    cross = add(2.0f, all, 4.0f * c) - far;
                    across = add(0.5f, far_v, add(4.0f, h, 5.0f * c) - (d + far_h));
                    down = add(0.5f, far_h, add(4.0f, v, 5.0f * c) - (d + far_v));
                    corners = add(-1.5f, far, add(2.0f, d, 6.0f * c));
                }
                const float share = SHARP ? 0.125f : 0.25f, half = SHARP ? 0.125f : 0.5f;
                const bool chroma = (i & 1) == column;
                found.v[3 * i + (blue ? 2 : 0)] = chroma ? same(c) : rounded(half, across);
                found.v[3 * i + 1] = chroma ? rounded(share, cross) : same(c);
                found.v[3 * i + (blue ? 0 : 2)] =
                    rounded(chroma ? share : half, chroma ? corners : down);
            }
            if (whole) {
                ((Colours*)(chunks + r * CHUNKS))[lane] = found;
                continue;
            }
            TYPE* to = colours.data + ((size_t)(top + r) * width + begin) * 3;
            if (aligned) {
                if (begin < width) *(Colours*)to = found;
                continue;
            }
#pragma unroll
            for (int i = 0; i < PART; ++i) {
                if (begin + i >= width) break;
#pragma unroll
                for (int c = 0; c < 3; ++c) to[3 * i + c] = found.v[3 * i + c];
            }
        }
        if (!whole) continue;
        __syncwarp();
        const int columns = width - left < 32 * PART ? width - left : 32 * PART;
        const int some = columns * 3 * sizeof(TYPE) / 16;
#pragma unroll
        for (int k = lane; k < ROWS * CHUNKS; k += 32) {
            const int r = k / CHUNKS, at = k % CHUNKS;
            uint4* to = (uint4*)(colours.data + ((size_t)(top + r) * width + left) * 3);
            if (top + r < height && at < some) to[at] = chunks[k];
        }
        __syncwarp();
    }
}
