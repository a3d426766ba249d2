#pragma once
// needs TOGETHER
// Bands between the references of a local Laplacian filter, of two by two pixels.
struct Bands {
    float lowest, step, sigma, slope;
    int references;
    bool single;  // whether the level is the image itself, which is remapped here

    // Add the bands of square `item` to plane `below` of the smaller level, times `share`.
    CUDA_CALLABLE void add(const float* fine, const float* coarse, int below, float share, int item,
                           int height, int width, float* to) const {
        const int tall = (height + 1) / 2, wide = (width + 1) / 2;
        const size_t plane = (size_t)height * width, small = (size_t)tall * wide;
        const Square square(item / wide, item % wide, height, width, tall, wide);
        const float scale = 1.0f / step;
        float place[4], own[4], least = (float)references, most = 0.0f;
        Square::Values total[1];
        square.expand(coarse + below * small, 0, 1, total);
        square.read(fine + (single ? 0 : references) * plane, own);
        for (int i = 0; i < 4; ++i) {
            total[0][i] = share * total[0][i];
            place[i] = (own[i] - lowest) * scale;
            least = fminf(least, place[i]);
            most = fmaxf(most, place[i]);
        }
        // References further off have no weight.
        const int last = most + 1.0f < (float)references ? (int)most + 1 : references - 1;
        // TOGETHER references are read before the first of them is used.
        for (int j = least > 0.0f ? (int)least : 0; j <= last; j += TOGETHER) {
            const int beside = TOGETHER > 1 && j < last ? 1 : 0;
            Square::Values other[TOGETHER], values[TOGETHER];
            if (!single) {
#pragma unroll
                for (int n = 0; n < TOGETHER; ++n)
                    square.read(fine + (j + n * beside) * plane, values[n]);
            }
            square.expand(coarse + j * small, beside * small, TOGETHER, other);
#pragma unroll
            for (int n = 0; n < TOGETHER; ++n) {
                if (n > beside) continue;
                float weight[4], any = 0.0f;
                for (int i = 0; i < 4; ++i) {
                    const float off = place[i] - (float)(j + n);
                    weight[i] = fmaxf(1.0f - fabsf(off), 0.0f);
                    any = fmaxf(any, weight[i]);
                }
                if (!(any > 0.0f)) continue;
                const float about = lowest + (float)(j + n) * step;
                for (int i = 0; i < 4; ++i) {
                    float value = values[n][i];
                    if (single) {
                        const float off = own[i] - about;
                        const float near = fminf(fmaxf(off, -sigma), sigma);
                        value = (about + near) + slope * (off - near);
                    }
                    total[0][i] += weight[i] * (value - other[n][i]);
                }
            }
        }
        square.write(total[0], to);
    }
};
