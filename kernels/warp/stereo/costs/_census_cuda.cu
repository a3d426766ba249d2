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

// needs TYPE, BLOCK
void census(wp::array_t<TYPE> image, int radius_y, int radius_x, int spacing, bool symmetric,
            wp::array_t<wp::uint64> bits) {
    const int height = image.shape[0], width = image.shape[1], channels = image.shape[2];
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    if (i >= (unsigned)height * width * channels) return;
    const unsigned pixel = i / channels;
    const int c = i % channels, y = pixel / width, x = pixel % width;
    const int reach_y = radius_y * spacing, reach_x = radius_x * spacing;
    const bool inside = y >= reach_y && y + reach_y < height && x >= reach_x && x + reach_x < width;
    const TYPE* const centre = image.data + i;
    const auto at = [&](int v, int u) {
        if (inside) return centre[(v * width + u) * channels];
        const int row = max(0, min(height - 1, y + v)), column = max(0, min(width - 1, x + u));
        return image.data[((size_t)row * width + column) * channels + c];
    };
    unsigned long long word = 0;
    int n = 0;
    for (int dy = -radius_y; dy <= (symmetric ? 0 : radius_y); ++dy)
        for (int dx = -radius_x; dx <= radius_x; ++dx) {
            if (dy == 0 && (symmetric ? dx >= 0 : dx == 0)) continue;
            const int v = dy * spacing, u = dx * spacing;
            const bool below = at(v, u) < (symmetric ? at(-v, -u) : *centre);
            word |= (unsigned long long)below << n++;
        }
    bits.data[i] = word;
}
