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
        const size_t step = (CHANNELS + 1) * small;
        if (end == 3 * (CHANNELS + 1)) {
            // Three exposures and the result are read before the first of them is used.
            Square::Values own[3], share[3], other[4] = {};
#pragma unroll
            for (int k = 0; k < 3; ++k) {
                square.read(fine + (k * (CHANNELS + 1) + c) * size, own[k]);
                square.read(fine + (k * (CHANNELS + 1) + CHANNELS) * size, share[k]);
            }
            if (!alone) square.expand(coarse + c * small, step, 4, other);
#pragma unroll
            for (int k = 0; k < 3; ++k)
                for (int i = 0; i < 4; ++i) other[3][i] += share[k][i] * (own[k][i] - other[k][i]);
            square.write(other[3], fine + (end + c) * size);
            return;
        }
        Square::Values total[1] = {}, other[1] = {};
        if (!alone) square.expand(coarse + (end + c) * small, 0, 1, total);
        for (int plane = 0; plane < end; plane += CHANNELS + 1) {
            float own[4], share[4];
            square.read(fine + (plane + c) * size, own);
            square.read(fine + (plane + CHANNELS) * size, share);
            if (!alone) square.expand(coarse + (plane + c) * small, 0, 1, other);
            for (int i = 0; i < 4; ++i) total[0][i] += share[i] * (own[i] - other[0][i]);
        }
        square.write(total[0], fine + (end + c) * size);
    }
};
