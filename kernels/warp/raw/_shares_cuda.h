#pragma once
// needs CHANNELS
// Bands of exposures, weighted and added up, of two by two pixels.
struct Shares {
    int end;  // planes of exposures: channels and the weight of each; then come those of the result
    bool alone;  // whether there is no smaller level

    // Add the bands of square `item` in channel c.
    CUDA_CALLABLE void add(float* fine, const float* coarse, int c, int item, int height,
                           int width) const {
        const int tall = (height + 1) / 2, wide = (width + 1) / 2;
        const size_t size = (size_t)height * width, small = (size_t)tall * wide;
        const Square square(item / wide, item % wide, height, width, tall, wide);
        float total[4] = {0.0f, 0.0f, 0.0f, 0.0f}, other[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        if (!alone) square.expand(coarse + (end + c) * small, total);
#pragma unroll 3
        for (int plane = 0; plane < end; plane += CHANNELS + 1) {
            float own[4], share[4];
            square.read(fine + (plane + c) * size, own);
            square.read(fine + (plane + CHANNELS) * size, share);
            if (!alone) square.expand(coarse + (plane + c) * small, other);
            for (int i = 0; i < 4; ++i) total[i] += share[i] * (own[i] - other[i]);
        }
        square.write(total, fine + (end + c) * size);
    }
};
