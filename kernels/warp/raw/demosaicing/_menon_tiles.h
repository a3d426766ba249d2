// Menon's demosaicing in tiles of TALL x WIDE pixels that a block of threads keeps in shared memory.
// The sums are those of the rows of _menon.h, in the same order. On the CPU, where this is tried,
// one thread does it all.

#include "../_mirror.h"

// needs TYPE, INTEGRAL, HIGHEST, TALL, WIDE, AROUND
void green_tiles(wp::array_t<TYPE> raw, int red_row, int red_column, wp::array_t<float> green,
                 wp::array_t<wp::uint8> levels) {
#pragma clang fp contract(off)
    enum { HALO = 6, ROWS = TALL + 2 * HALO, COLUMNS = WIDE + 2 * HALO };
#if defined(__CUDA_ARCH__)
    __shared__ float samples[ROWS * COLUMNS], across[ROWS * COLUMNS], down[ROWS * COLUMNS];
    const int thread = threadIdx.x, threads = blockDim.x, block = blockIdx.x, blocks = gridDim.x;
#else
    float samples[ROWS * COLUMNS], across[ROWS * COLUMNS], down[ROWS * COLUMNS];
    const int thread = 0, threads = 1, block = 0, blocks = 1;
#endif
    const auto wait = [] {
#if defined(__CUDA_ARCH__)
        __syncthreads();
#endif
    };
    const auto size = [](float x) { return x < 0.0f ? -x : x; };
    const int height = raw.shape[0], width = raw.shape[1];
    const int wide = (green.shape[1] + WIDE - 1) / WIDE;
    const int tiles = (green.shape[0] + TALL - 1) / TALL * wide;
    for (int tile = block; tile < tiles; tile += blocks) {
        // Place (0, 0) of the tile in the image; AROUND pixels beyond it are computed too.
        const int top = tile / wide * TALL - AROUND - HALO;
        const int left = tile % wide * WIDE - AROUND - HALO;
        for (int i = thread; i < ROWS * COLUMNS; i += threads) {
            const int y = Mirror::at(top + i / COLUMNS, height);
            const int x = Mirror::at(left + i % COLUMNS, width);
            samples[i] = (float)raw.data[(size_t)y * width + x];
        }
        wait();
        // Only red and blue samples have differences. At green pixels nothing changes, and the
        // direction is along the row.
        const auto first = [=](int v, int u) {
            return u + (((top + v) ^ red_row ^ (left + u) ^ red_column) & 1);
        };
        for (int i = thread; i < (ROWS - 4) * (COLUMNS / 2 - 2); i += threads) {
            const int v = i / (COLUMNS / 2 - 2) + 2;
            const int u = first(v, 2 + i % (COLUMNS / 2 - 2) * 2);
            const float* p = samples + v * COLUMNS + u;
            const float c = p[0];
            const float h = 0.5f * (p[-1] + p[1]) + (0.5f * c - 0.25f * (p[-2] + p[2]));
            const float w = 0.5f * (p[-COLUMNS] + p[COLUMNS]) +
                            (0.5f * c - 0.25f * (p[-2 * COLUMNS] + p[2 * COLUMNS]));
            across[v * COLUMNS + u] = c - h;
            down[v * COLUMNS + u] = c - w;
        }
        wait();
        for (int i = thread; i < TALL * WIDE / 2; i += threads) {
            const int v = i / (WIDE / 2) + HALO, u = i % (WIDE / 2) * 2 + HALO;
            const int chroma = first(v, u), at = v * COLUMNS + chroma;
            float along = 0.0f, upright = 0.0f;
            for (int k = -2; k <= 2; ++k) {
                const float *h = across + at + k * COLUMNS, *w = down + at + k;
                const float weight = k == 0 ? 3.0f : 1.0f;
                if (k & 1) {
                    along += size(h[-1] - h[1]);
                    upright += size(w[-COLUMNS] - w[COLUMNS]);
                } else {
                    along += weight * size(h[0] - h[2]);
                    along += weight * size(h[-2] - h[0]);
                    upright += weight * size(w[0] - w[2 * COLUMNS]);
                    upright += weight * size(w[-2 * COLUMNS] - w[0]);
                }
            }
            const bool flat = upright >= along;
            const float found = samples[at] - (flat ? across[at] : down[at]);
            const int y = top + AROUND + v;
            if (y >= green.shape[0]) continue;
            for (int n = 0; n < 2; ++n) {
                const int x = left + AROUND + u + n;
                if (x >= green.shape[1]) continue;
                const size_t to = (size_t)y * green.shape[1] + x;
                levels.data[to] = u + n != chroma || flat ? 1 : 0;
                green.data[to] = u + n == chroma ? found : samples[v * COLUMNS + u + n];
            }
        }
        wait();
    }
}

// needs TYPE, INTEGRAL, HIGHEST, TALL, WIDE, AROUND
void colour_tiles(wp::array_t<TYPE> raw, int red_row, int red_column, wp::array_t<float> greens,
                  wp::array_t<wp::uint8> levels, wp::array_t<TYPE> colours) {
#pragma clang fp contract(off)
    enum { ROWS = TALL + 2 * AROUND, COLUMNS = WIDE + 2 * AROUND, SIZE = ROWS * COLUMNS };
#if defined(__CUDA_ARCH__)
    __shared__ float samples[SIZE], red[SIZE], blue[SIZE], green[SIZE];
    __shared__ unsigned char level[SIZE];
    const int thread = threadIdx.x, threads = blockDim.x, block = blockIdx.x, blocks = gridDim.x;
#else
    float samples[SIZE], red[SIZE], blue[SIZE], green[SIZE];
    unsigned char level[SIZE];
    const int thread = 0, threads = 1, block = 0, blocks = 1;
#endif
    const auto wait = [] {
#if defined(__CUDA_ARCH__)
        __syncthreads();
#endif
    };
    const float third = 1.0f / 3.0f;
    const int height = raw.shape[0], width = raw.shape[1];
    const int wide = (width + WIDE - 1) / WIDE, tiles = (height + TALL - 1) / TALL * wide;
    for (int tile = block; tile < tiles; tile += blocks) {
        const int top = tile / wide * TALL - AROUND, left = tile % wide * WIDE - AROUND;
        for (int i = thread; i < SIZE; i += threads) {
            const int y = top + i / COLUMNS, x = left + i % COLUMNS;
            samples[i] =
                (float)raw.data[(size_t)Mirror::at(y, height) * width + Mirror::at(x, width)];
            // The planes begin AROUND pixels before the image; tiles may end behind them.
            const int v = y + AROUND, u = x + AROUND;
            const bool there = v < greens.shape[0] && u < greens.shape[1];
            const size_t from = there ? (size_t)v * greens.shape[1] + u : 0;
            green[i] = greens.data[from];
            level[i] = levels.data[from];
            red[i] = blue[i] = 0.0f;
        }
        wait();
        // Steps AT_GREEN, AT_CHROMA, REFINE_GREEN, REFINE_AT_GREEN and REFINE_AT_CHROMA, each of
        // which needs one pixel more around. A step reads only what it does not change: pixels of
        // the other kind, and its own. Unrolled, so that divisors are constants.
#pragma unroll
        for (int step = 1; step <= 5; ++step) {
            const int columns = WIDE / 2 + AROUND - step;  // every second pixel of a row
            const bool chroma = step == 2 || step == 3 || step == 5;
            for (int i = thread; i < (ROWS - 2 * step) * columns; i += threads) {
                const int v = i / columns + step;
                const bool below = ((top + v) & 1) != red_row;
                const int column = below == chroma ? 1 - red_column : red_column;
                const int u = step + i % columns * 2 + ((left + step + column) & 1);
                const int x = v * COLUMNS + u;
                float *own = below ? blue : red, *other = below ? red : blue;
                const bool flat = level[x] > 0;
                const auto along = [&](const float* a) { return 0.5f * (a[x - 1] + a[x + 1]); };
                const auto upright = [&](const float* a) {
                    return 0.5f * (a[x - COLUMNS] + a[x + COLUMNS]);
                };
                const auto mean = [&](const float* a, const float* b) {
                    const int s = flat ? 1 : COLUMNS;
                    return ((a[x - s] - b[x - s]) + (a[x] - b[x])) + (a[x + s] - b[x + s]);
                };
                const float c = samples[x];
                if (step == 1) {
                    own[x] = (c + along(samples)) - along(green);
                    other[x] = (c + upright(samples)) - upright(green);
                } else if (step == 2) {
                    other[x] = flat ? (c + along(other)) - along(own)
                                    : (c + upright(other)) - upright(own);
                    own[x] = c;
                } else if (step == 3) {
                    green[x] = own[x] + -third * mean(own, green);
                } else if (step == 4) {
                    const float h = (own[x - 1] - green[x - 1]) + (own[x + 1] - green[x + 1]);
                    const float w = (other[x - COLUMNS] - green[x - COLUMNS]) +
                                    (other[x + COLUMNS] - green[x + COLUMNS]);
                    own[x] = green[x] + 0.5f * h;
                    other[x] = green[x] + 0.5f * w;
                } else if (step == 5) {
                    other[x] = own[x] + third * mean(other, own);
                }
            }
            wait();
        }
        const auto rounded = [](float value) {
            if (!INTEGRAL) return (TYPE)value;
            const float most = (float)HIGHEST;
            value += 0.5f;
            return (TYPE)(int)(value < 0.0f ? 0.0f : value > most ? most : value);
        };
        for (int i = thread; i < TALL * WIDE; i += threads) {
            const int y = top + AROUND + i / WIDE, x = left + AROUND + i % WIDE;
            if (y >= height || x >= width) continue;
            const int at = (i / WIDE + AROUND) * COLUMNS + i % WIDE + AROUND;
            TYPE* to = colours.data + ((size_t)y * width + x) * 3;
            to[0] = rounded(red[at]);
            to[1] = rounded(green[at]);
            to[2] = rounded(blue[at]);
        }
        wait();
    }
}
