#include "_hamming_cuda.h"

// needs COST, SAD, SSD, CENSUS, ZNCC, BIRCHFIELD_TOMASI, PIXEL, VALUE, SUM, KEPT
// needs FLOATS, UNROLL, DOWN, BLOCK
// The sums down the columns, in a strip of rows that begins at `top`. One thread computes DOWN rows
// of one column and one disparity.
void sum_down(wp::array_t<PIXEL> left, wp::array_t<PIXEL> right, Windows windows, int top,
              wp::array_t<KEPT> sums) {
    const int height = left.shape[0], width = left.shape[1], channels = left.shape[2];
    const int rows = sums.shape[0], wide = sums.shape[1], depth = sums.shape[2];
    const int radius_y = windows.radius_y;
    const unsigned columns = (unsigned)wide * depth, blocks = (columns - 1) / BLOCK + 1;
    const unsigned i = blockIdx.x % blocks * BLOCK + threadIdx.x;
    if (i >= columns) return;
    const int begin = blockIdx.x / blocks * DOWN, end = min(begin + DOWN, rows);
    const int x = (int)(i / depth) - windows.radius_x;
    const int partner = x - windows.first - (int)(i % depth);
    const auto inside = [&](int column) { return max(0, min(width - 1, column)) * channels; };
    const int left_here = inside(x), right_here = inside(partner);
#if COST == BIRCHFIELD_TOMASI
    const int left_before = inside(x - 1) - left_here, left_behind = inside(x + 1) - left_here;
    const int right_before = inside(partner - 1) - right_here;
    const int right_behind = inside(partner + 1) - right_here;
#endif
    const auto cost_of = [&](int y) {
        const size_t row = (size_t)max(0, min(height - 1, y)) * width * channels;
        const PIXEL* l = (const PIXEL*)left.data + row + left_here;
        const PIXEL* r = (const PIXEL*)right.data + row + right_here;
        SUM total = 0;
        for (int c = 0; c < channels; ++c, ++l, ++r) {
            const VALUE a = __ldg(l), b = __ldg(r);
#if COST == SAD
            total += a < b ? b - a : a - b;
#elif COST == SSD
            total += (a - b) * (a - b);
#elif COST == CENSUS
            total += Hamming::distance(a, b);
#elif COST == ZNCC
            total += (SUM)a * (SUM)b;
#else
            const VALUE a0 = (__ldg(l + left_before) + a) / 2;
            const VALUE a1 = (a + __ldg(l + left_behind)) / 2;
            const VALUE b0 = (__ldg(r + right_before) + b) / 2;
            const VALUE b1 = (b + __ldg(r + right_behind)) / 2;
            const VALUE over = max(b - max(a, max(a0, a1)), min(a, min(a0, a1)) - b);
            const VALUE under = max(a - max(b, max(b0, b1)), min(b, min(b0, b1)) - a);
            total += max((VALUE)0, min(over, under));
#endif
        }
        return total;
    };
    const auto sum_of = [&](int y) {
        SUM down = 0;
#pragma unroll 4
        for (int v = y - radius_y; v <= y + radius_y; ++v) down += cost_of(v);
        return down;
    };
    KEPT* to = sums.data + (size_t)begin * columns + i;
    SUM down = sum_of(top + begin);
    *to = down;
// Loads through __ldg do not wait for stores, so the loads of several rounds overlap.
#pragma unroll UNROLL
    for (int y = top + begin + 1; y < top + end; ++y) {
        if (FLOATS || radius_y == 0)
            down = sum_of(y);
        else
            down += cost_of(y + radius_y) - cost_of(y - radius_y - 1);
        *(to += columns) = down;
    }
}
