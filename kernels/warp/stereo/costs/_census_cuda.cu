#include "_hamming_cuda.h"

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
