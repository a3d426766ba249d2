#pragma once
// Levels of pyramids on CUDA. A warp makes the next smaller level of a strip of columns, from the top
// down: each lane has four columns of the larger level and two of the smaller one, and the outer
// lanes only help. A thread makes two by two values of the next larger level. The sums are those of
// _pyramid.h. Places within a plane fit an int: the API takes at most 2^29 values.
// needs PART
struct Strip {
    enum { LANES = 30, WIDE = 2 * LANES };  // columns are those of the smaller level

    // Four values of a row from column `first` on, as they are read: to choose among them is to wait
    // for them.
    static CUDA_CALLABLE float4 load(const float* row, int first, int width, bool aligned) {
        if (aligned) {
            const int at = first < 0 ? 0 : first + 4 > width ? width - 4 : first;
            return *(const float4*)(row + at);
        }
        return make_float4(row[Mirror::at(first, width)], row[Mirror::at(first + 1, width)],
                           row[Mirror::at(first + 2, width)], row[Mirror::at(first + 3, width)]);
    }

    // The same in order. Beyond the borders only those are right that `across` uses: two before the
    // row and one after it.
    static CUDA_CALLABLE void settle(const float4& four, int first, int width, bool aligned,
                                     float* out) {
        out[0] = aligned && first >= width ? four.z : four.x;
        out[1] = four.y;
        out[2] = four.z;
        out[3] = aligned && first < 0 ? four.y : four.w;
    }

    // The two values of the smaller level, from the weighed columns of all lanes.
    static CUDA_CALLABLE void across(const float* v, float* out) {
        const float before = __shfl_up_sync(0xffffffffu, v[2], 1);
        const float last = __shfl_up_sync(0xffffffffu, v[3], 1);
        const float next = __shfl_down_sync(0xffffffffu, v[0], 1);
        out[0] = Pyramid::weigh(before, last, v[0], v[1], v[2]);
        out[1] = Pyramid::weigh(v[0], v[1], v[2], v[3], next);
    }

    // Write those of the two values that are the lane's and within the row; `column` is even.
    static CUDA_CALLABLE void write(const float* v, int lane, int column, int width, float* row) {
        if (lane < 1 || lane > LANES || column >= width) return;
        if (width % 2 == 0) {
            *(float2*)(row + column) = make_float2(v[0], v[1]);
        } else {
            row[column] = v[0];
            if (column + 1 < width) row[column + 1] = v[1];
        }
    }
};

// Two by two values of a level: their places, and those of the values of the smaller level, `wide` in
// a row, that they are made of.
struct Square {
    typedef float Values[4];
    int rows[3], columns[3];  // rows as places of the first of three values side by side
    int own[3];               // places of the values of these rows in column x
    int at[4];                // places beyond the border are the first one's, and are not written
    bool right, lower, whole;
    bool narrow;       // whether the smaller level has fewer columns than three
    bool first, last;  // whether the square is at the left border, or at the right one
    bool odd;          // whether the level has an odd number of columns

    CUDA_CALLABLE Square(int y, int x, int height, int width, int tall, int wide) {
        for (int k = 0; k < 3; ++k) {
            rows[k] = (k == 1 ? y : Pyramid::place(y + k - 1, tall, height)) * wide;
            columns[k] = k == 1 ? x : Pyramid::place(x + k - 1, wide, width);
            own[k] = rows[k] + x;
        }
        narrow = wide < 3;
        first = x == 0;
        last = x == wide - 1;
        odd = width & 1;
        if (!narrow) {
            const int left = first ? 0 : last ? wide - 3 : x - 1;
            for (int k = 0; k < 3; ++k) rows[k] += left;
        }
        right = 2 * x + 1 < width;
        lower = 2 * y + 1 < height;
        whole = width % 2 == 0 && lower;
        at[0] = 2 * y * width + 2 * x;
        at[1] = right ? at[0] + 1 : at[0];
        at[2] = lower ? at[0] + width : at[0];
        at[3] = right && lower ? at[2] + 1 : at[0];
    }

    // At a border, the three columns that there are in place of those around x.
    CUDA_CALLABLE void arrange(float* v) const {
        const float a = v[0], b = v[1], c = v[2];
        v[0] = b;
        v[1] = first ? a : c;
        v[2] = first || odd ? b : c;
    }

    // The four values of a plane of the level itself, row by row.
    CUDA_CALLABLE void read(const float* from, float* out) const {
        if (whole) {
            const float2 upper = *(const float2*)(from + at[0]),
                         low = *(const float2*)(from + at[2]);
            out[0] = upper.x;
            out[1] = upper.y;
            out[2] = low.x;
            out[3] = low.y;
        } else {
            for (int i = 0; i < 4; ++i) out[i] = from[at[i]];
        }
    }

    CUDA_CALLABLE void write(const float* v, float* to) const {
        if (whole) {
            *(float2*)(to + at[0]) = make_float2(v[0], v[1]);
            *(float2*)(to + at[2]) = make_float2(v[2], v[3]);
        } else {
            to[at[0]] = v[0];
            if (right) to[at[1]] = v[1];
            if (lower) to[at[2]] = v[2];
            if (right && lower) to[at[3]] = v[3];
        }
    }

    // The four values of planes of the smaller level, at most four and `step` values apart, enlarged.
    CUDA_CALLABLE void expand(const float* from, size_t step, int count, Values* out) const {
        float even[4][3], half[4][3];
        if (!narrow) {
            // Three values side by side need one address.
#pragma unroll
            for (int c = 0; c < 4 && c < count; ++c) {
                const float *before = from + c * step + rows[0], *here = from + c * step + rows[1];
                const float* after = from + c * step + rows[2];
#pragma unroll
                for (int k = 0; k < 3; ++k) {
                    const float own = here[k], next = after[k];
                    even[c][k] = Pyramid::even(before[k], own, next);
                    half[c][k] = 0.5f * (own + next);
                }
            }
            if (first || last) {
#pragma unroll
                for (int c = 0; c < 4 && c < count; ++c) arrange(even[c]), arrange(half[c]);
            }
        } else {
#pragma unroll
            for (int c = 0; c < 4 && c < count; ++c)
#pragma unroll
                for (int k = 0; k < 3; ++k) {
                    const float* p = from + c * step + columns[k];
                    const float own = p[rows[1]], next = p[rows[2]];
                    even[c][k] = Pyramid::even(p[rows[0]], own, next);
                    half[c][k] = 0.5f * (own + next);
                }
        }
#pragma unroll
        for (int c = 0; c < 4 && c < count; ++c) {
            out[c][0] = Pyramid::even(even[c][0], even[c][1], even[c][2]);
            out[c][1] = 0.5f * (even[c][1] + even[c][2]);
            out[c][2] = Pyramid::even(half[c][0], half[c][1], half[c][2]);
            out[c][3] = 0.5f * (half[c][1] + half[c][2]);
        }
    }

    // The same where the lanes of a warp have neighbouring columns and the outer ones only help.
    CUDA_CALLABLE void expand_together(const float* from, size_t step, int count,
                                       Values* out) const {
        float even[4], half[4];
#pragma unroll
        for (int c = 0; c < 4 && c < count; ++c) {
            const float* plane = from + c * step;
            const float here = plane[own[1]], after = plane[own[2]];
            even[c] = Pyramid::even(plane[own[0]], here, after);
            half[c] = 0.5f * (here + after);
        }
#pragma unroll
        for (int c = 0; c < 4 && c < count; ++c) {
            between(even[c], out[c]);
            between(half[c], out[c] + 2);
        }
    }

    // Two values of a row, from the value of the lane and those of the lanes beside it.
    CUDA_CALLABLE void between(float v, float* out) const {
        const int lane = threadIdx.x % 32;
        const int before = first ? (last ? lane : lane + 1) : lane - 1;
        const int after = last ? (odd && !first ? lane - 1 : lane) : lane + 1;
        const float left = __shfl_sync(0xffffffffu, v, before);
        const float right = __shfl_sync(0xffffffffu, v, after);
        out[0] = Pyramid::even(left, v, right);
        out[1] = 0.5f * (v + right);
    }
};
