#pragma once
// Levels of pyramids on CUDA. A warp makes the next smaller level of a strip of columns, from the top
// down: each lane has four columns of the larger level and two of the smaller one, and the outer
// lanes only help. A thread makes two by two values of the next larger level. The sums are those of
// _pyramid.h.
// needs PART
struct Strip {
    enum {
        LANES = 30,
        ROWS = 2,
        WIDE = 2 * LANES
    };  // rows and columns are those of the smaller level

    // Four values of a row from column `first` on.
    static CUDA_CALLABLE void load(const float* row, int first, int width, bool aligned,
                                   float* out) {
        if (aligned && first >= 0 && first + 4 <= width) {
            const float4 four = *(const float4*)(row + first);
            out[0] = four.x;
            out[1] = four.y;
            out[2] = four.z;
            out[3] = four.w;
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

    // Write those of the two values that are the lane's and within the row.
    static CUDA_CALLABLE void write(const float* v, int lane, int column, int width, float* row) {
        if (lane < 1 || lane > LANES) return;
        for (int i = 0; i < 2; ++i)
            if (column + i < width) row[column + i] = v[i];
    }
};

// Where the values of the smaller level are that two by two values of the larger one are made of.
struct Square {
    int rows[3], columns[3];  // rows as places of their first value

    CUDA_CALLABLE Square(int y, int x, int height, int width, int tall, int wide) {
        for (int k = 0; k < 3; ++k) {
            rows[k] = (k == 1 ? y : Pyramid::place(y + k - 1, tall, height)) * wide;
            columns[k] = k == 1 ? x : Pyramid::place(x + k - 1, wide, width);
        }
    }

    // The four values of a plane, row by row.
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
