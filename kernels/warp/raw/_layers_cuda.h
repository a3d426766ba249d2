#pragma once
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
        float total[4], place[4], other[4], own[4], least = (float)references, most = 0.0f;
        square.expand(coarse + below * small, total);
        square.read(fine + (single ? 0 : references) * plane, own);
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
            if (!single) square.read(fine + j * plane, own);
            square.expand(coarse + j * small, other);
            for (int i = 0; i < 4; ++i) {
                float value = own[i];
                if (single) {
                    const float off = value - about;
                    const float near = fminf(fmaxf(off, -sigma), sigma);
                    value = (about + near) + slope * (off - near);
                }
                total[i] += weight[i] * (value - other[i]);
            }
        }
        square.write(total, to);
    }
};
