#include "_hamming_cuda.h"

// The census of four neighbouring pixels, whose windows of 5 x 5 share 5 x 8 pixels.
void census_of_24(wp::array_t<wp::uint8> image, wp::array_t<wp::uint64> bits) {
    const int height = image.shape[0], width = image.shape[1], groups = (width + 3) / 4;
    const unsigned item = blockIdx.x * blockDim.x + threadIdx.x;
    const int y = item / groups, x = 4 * (int)(item - (unsigned)y * groups);
    if (y >= height) return;
    int value[5][8];
    const bool whole = width % 4 == 0 && (size_t)image.data % 4 == 0 && x >= 4 && x + 8 <= width;
#pragma unroll
    for (int i = 0; i < 5; ++i) {
        const wp::uint8* from = image.data + (size_t)max(0, min(height - 1, y + i - 2)) * width;
        if (whole) {
            const unsigned* words = (const unsigned*)(from + x);
            const unsigned before = words[-1], here = words[0], after = words[1];
#pragma unroll
            for (int j = 0; j < 8; ++j)
                value[i][j] = (j < 2   ? before >> 8 * (j + 2)
                               : j < 6 ? here >> 8 * (j - 2)
                                       : after >> 8 * (j - 6)) &
                              255;
        } else {
#pragma unroll
            for (int j = 0; j < 8; ++j) value[i][j] = from[max(0, min(width - 1, x + j - 2))];
        }
    }
    unsigned word[4] = {0, 0, 0, 0};
#pragma unroll
    for (int p = 0; p < 4; ++p) {
        int n = 0;
#pragma unroll
        for (int i = 0; i < 5; ++i) {
#pragma unroll
            for (int j = 0; j < 5; ++j) {
                if (i == 2 && j == 2) continue;
                if (value[i][p + j] < value[2][p + 2]) word[p] |= 1u << n;
                ++n;
            }
        }
    }
    wp::uint64* to = bits.data + (size_t)y * width + x;
    if (whole && (size_t)to % 16 == 0) {
        ((uint4*)to)[0] = make_uint4(word[0], 0, word[1], 0);
        ((uint4*)to)[1] = make_uint4(word[2], 0, word[3], 0);
        return;
    }
    for (int p = 0; p < 4 && x + p < width; ++p) to[p] = word[p];
}

// needs BLOCK, TILE
void distances(wp::array_t<wp::uint64> left, wp::array_t<wp::uint64> right, int first,
               wp::array_t<wp::uint8> costs) {
    const int width = left.shape[1], channels = left.shape[2], depth = costs.shape[2];
    const int tiles = (width + TILE - 1) / TILE, y = blockIdx.x / tiles;
    const int begin = blockIdx.x % tiles * TILE, end = min(begin + TILE, width);
    const size_t row = (size_t)y * width * channels;
    const unsigned long long* const l = (const unsigned long long*)left.data + row;
    const unsigned long long* const r = (const unsigned long long*)right.data + row;
    int x = begin + threadIdx.x / depth, k = threadIdx.x % depth;
    const int step_x = BLOCK / depth, step_k = BLOCK % depth, count = (end - begin) * depth;
#pragma unroll 4
    for (int i = threadIdx.x; i < count; i += BLOCK) {
        const int partner = max(0, min(width - 1, x - first - k));
        int total = 0;
        for (int c = 0; c < channels; ++c)
            total +=
                Hamming::distance(__ldg(l + x * channels + c), __ldg(r + partner * channels + c));
        costs.data[((size_t)y * width + x) * depth + k] = total;
        x += step_x;
        k += step_k;
        if (k >= depth) {
            k -= depth;
            ++x;
        }
    }
}
