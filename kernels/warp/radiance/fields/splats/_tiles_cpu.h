#include "_gauss_cpu.h"

// needs TILE, SHOWN, FAINT, MOST, Tiles, Seen
// Composite the pixels of a tile, front to back.
void composite_tile(int tile, Tiles tiles, Seen seen) {
#pragma clang fp contract(off)
    using Lanes = SplatRow::Lanes;
    const int width = tiles.width, height = tiles.height;
    const float stop = tiles.stop;
    const int columns = (width + TILE - 1) / TILE;
    const int top = tile / columns * TILE, left = tile % columns * TILE;
    Lanes through[TILE], red[TILE], green[TILE], blue[TILE], far[TILE];
    for (int r = 0; r < TILE; ++r) {
        // Pixels beside the image need no light.
        for (int k = 0; k < TILE; ++k)
            through[r][k] = top + r < height && left + k < width ? 1.0f : 0.0f;
        red[r] = green[r] = blue[r] = far[r] = 0.0f;
    }
    const int begin = tiles.ranges.data[tile], end = tiles.ranges.data[tile + 1];
    for (int place = begin; place < end; ++place) {
        if ((place - begin) % 8 == 7 && !SplatRow::alive(through, stop)) break;
        const float* s = tiles.shown.data + (size_t)SHOWN * tiles.entries.data[place];
        const int behind = SplatRow::last(s, top);
        for (int r = SplatRow::first(s, top); r <= behind; ++r) {
            const SplatRow here(s, top + r, left, through[r], stop);
            const Lanes weight = here.on ? through[r] * here.alpha : (Lanes)(0.0f);
            red[r] += weight * s[6];
            green[r] += weight * s[7];
            blue[r] += weight * s[8];
            far[r] += weight * s[9];
            through[r] -= weight;
        }
    }
    for (int r = 0; r < TILE && top + r < height; ++r) {
        for (int k = 0; k < TILE && left + k < width; ++k) {
            const size_t ray = (size_t)(top + r) * width + left + k;
            seen.color.data[3 * ray] = red[r][k];
            seen.color.data[3 * ray + 1] = green[r][k];
            seen.color.data[3 * ray + 2] = blue[r][k];
            seen.opacity.data[ray] = 1.0f - through[r][k];
            seen.depth.data[ray] = far[r][k];
        }
    }
}

// needs TILE, SHOWN, SLOPES, FAINT, MOST, Tiles, Seen
// Compute the gradients of the entries of a tile, front to back.
void trace_tile(int tile, Seen d_seen, Tiles tiles, Seen seen, wp::array_t<float> slopes) {
#pragma clang fp contract(off)
    using Lanes = SplatRow::Lanes;
    const int width = tiles.width, height = tiles.height;
    const float stop = tiles.stop;
    const int columns = (width + TILE - 1) / TILE;
    const int top = tile / columns * TILE, left = tile % columns * TILE;
    const Lanes none = 0.0f;
    Lanes through[TILE], rest[TILE], g[4][TILE];
    for (int r = 0; r < TILE; ++r) {
        through[r] = rest[r] = g[0][r] = g[1][r] = g[2][r] = g[3][r] = none;
        for (int k = 0; k < TILE && top + r < height && left + k < width; ++k) {
            const size_t ray = (size_t)(top + r) * width + left + k;
            through[r][k] = 1.0f;
            float total = 0.0f;
            for (int c = 0; c < 3; ++c) {
                g[c][r][k] = d_seen.color.data[3 * ray + c];
                total += g[c][r][k] * seen.color.data[3 * ray + c];
            }
            g[3][r][k] = d_seen.opacity.data[ray];
            rest[r][k] = total + g[3][r][k] * seen.opacity.data[ray];
        }
    }
    const int begin = tiles.ranges.data[tile], end = tiles.ranges.data[tile + 1];
    bool alive = true;
    for (int place = begin; place < end; ++place) {
        float* to = slopes.data + (size_t)SLOPES * tiles.sources.data[place];
        if (alive && (place - begin) % 8 == 7) alive = SplatRow::alive(through, stop);
        Lanes sums[SLOPES];
        for (int n = 0; n < SLOPES; ++n) sums[n] = none;
        const float* s = tiles.shown.data + (size_t)SHOWN * tiles.entries.data[place];
        const int behind = alive ? SplatRow::last(s, top) : -1;
        for (int r = SplatRow::first(s, top); r <= behind; ++r) {
            const SplatRow here(s, top + r, left, through[r], stop);
            const Lanes weight = here.on ? through[r] * here.alpha : none;
            const Lanes slope = g[0][r] * s[6] + g[1][r] * s[7] + g[2][r] * s[8] + g[3][r];
            const Lanes left_over = through[r] - weight;
            rest[r] -= weight * slope;
            const Lanes shadow = left_over > stop ? rest[r] / (1.0f - here.alpha) : none;
            // The opacity at a pixel is constant where it is the largest one.
            const Lanes d =
                (here.on & (here.alpha < MOST)) ? (through[r] * slope - shadow) * here.alpha : none;
            sums[0] -= (s[2] * here.dx + s[3] * here.dy) * d;
            sums[1] -= (s[4] * here.dy + s[3] * here.dx) * d;
            sums[2] -= 0.5f * here.dx * here.dx * d;
            sums[3] -= here.dx * here.dy * d;
            sums[4] -= 0.5f * here.dy * here.dy * d;
            sums[5] += d;
            sums[6] += weight * g[0][r];
            sums[7] += weight * g[1][r];
            sums[8] += weight * g[2][r];
            through[r] = left_over;
        }
        for (int n = 0; n < SLOPES; ++n) {
            float total = 0.0f;
            for (int k = 0; k < TILE; ++k) total += sums[n][k];
            to[n] = n == 5 ? total / s[5] : total;
        }
    }
}
