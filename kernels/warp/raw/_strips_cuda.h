#pragma once
// Levels of pyramids on CUDA. A warp makes the next smaller level of a strip of columns, from the top
// down: each lane has four columns of the larger level and two of the smaller one, and the outer
// lanes only help. A thread makes two by two values of the next larger level. The sums are those of
// _pyramid.h. Places within a plane fit an int: the API takes at most 2^29 values.
// needs PART
struct Strip {
    enum { LANES = 30, WIDE = 2 * LANES };  // columns are those of the smaller level

    // Four values of a row from column `first` on. Beyond the borders only those are right that
    // `across` uses: two before the row and one after it.
    static CUDA_CALLABLE void load(const float* row, int first, int width, bool aligned,
                                   float* out) {
        if (aligned) {
            const int at = first < 0 ? 0 : first + 4 > width ? width - 4 : first;
            const float4 four = *(const float4*)(row + at);
            out[0] = first < width ? four.x : four.z;
            out[1] = four.y;
            out[2] = four.z;
            out[3] = first < 0 ? four.y : four.w;
        } else {
            for (int i = 0; i < 4; ++i) out[i] = row[Mirror::at(first + i, width)];
        }
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
    int rows[3], columns[3];  // rows as places of their first value
    int at[4];                // places beyond the border are the first one's, and are not written
    bool right, lower, whole;

    CUDA_CALLABLE Square(int y, int x, int height, int width, int tall, int wide) {
        for (int k = 0; k < 3; ++k) {
            rows[k] = (k == 1 ? y : Pyramid::place(y + k - 1, tall, height)) * wide;
            columns[k] = k == 1 ? x : Pyramid::place(x + k - 1, wide, width);
        }
        right = 2 * x + 1 < width;
        lower = 2 * y + 1 < height;
        whole = width % 2 == 0 && lower;
        at[0] = 2 * y * width + 2 * x;
        at[1] = right ? at[0] + 1 : at[0];
        at[2] = lower ? at[0] + width : at[0];
        at[3] = right && lower ? at[2] + 1 : at[0];
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

    // The four values of a plane of the smaller level, enlarged.
    CUDA_CALLABLE void expand(const float* from, float* out) const {
        float even[3], odd[3];
        for (int k = 0; k < 3; ++k) {
            const float* p = from + columns[k];
            const float here = p[rows[1]], after = p[rows[2]];
            even[k] = Pyramid::even(p[rows[0]], here, after);
            odd[k] = 0.5f * (here + after);
        }
        out[0] = Pyramid::even(even[0], even[1], even[2]);
        out[1] = 0.5f * (even[1] + even[2]);
        out[2] = Pyramid::even(odd[0], odd[1], odd[2]);
        out[3] = 0.5f * (odd[1] + odd[2]);
    }
};
