#include "../../_harmonics.h"
#pragma once

// A warp's walk along a ray through a grid of density and colour, 32 positions at a time. Those
// that are not empty are then processed `rows` at a time: `each` lanes read rows of the grid for
// one position, or add to them, four coefficients each.
struct VoxelWalk {
    const Space& space;
    const March& march;
    const Grid& grid;
    float stop;
    int lane, each, part, from;
    unsigned own;  // one sample in `rows`
    float o[3], d[3], bands[3][4];
    float first, last, left, sum_w, sum_wt;
    // The position of this lane, and its sample: the node, w, and the light left after it.
    int node;
    float f[3], t, gap, sigma, w, behind, rgb[3];
    float ahead_w, ahead_wt;  // sums of w and w t before this one
    unsigned seen;            // the lanes whose samples light reaches

    VoxelWalk(int ray, float jitter, const Rays& rays, const Space& space, const March& march,
              const Grid& grid, float stop)
        : space(space), march(march), grid(grid), stop(stop) {
        const unsigned all = 0xffffffffu;
        lane = threadIdx.x & 31;
        each = grid.color.shape[3] / 4;  // lanes of a row
        const int rows = 32 / each;
        part = lane & (each - 1);
        from = (lane & (rows - 1)) * each;
        own = all / ((1u << rows) - 1) << lane / each;
        for (int k = 0; k < 3; ++k) {
            o[k] = rays.origins.data[3 * (size_t)ray + k];
            d[k] = rays.directions.data[3 * (size_t)ray + k];
        }
        float h[16];
        Harmonics::write(d[0], d[1], d[2], h);
        for (int k = 0; k < 4; ++k) {
            const int n = 4 * part + k, b = n % grid.basis;
            float value = h[8];  // by comparisons, because an index would move the array to memory
#pragma unroll
            for (int i = 0; i < 8; ++i) value = b == i ? h[i] : value;
            for (int c = 0; c < 3; ++c) bands[c][k] = n / grid.basis == c ? value : 0.0f;
        }
        first = march.near;
        last = march.far;
        if (!space.unbounded)
            for (int k = 0; k < 3; ++k) {
                const float inverse =
                    1.0f / (fabsf(d[k]) < 1e-12f ? copysignf(1e-12f, d[k]) : d[k]);
                const float a = (-1.0f - o[k]) * inverse, b = (1.0f - o[k]) * inverse;
                first = fmaxf(first, fminf(a, b));
                last = fminf(last, fmaxf(a, b));
            }
        first += jitter * fmaxf(march.finest, march.cone * first);
        left = 1.0f;
        sum_w = sum_wt = 0.0f;
    }

    static float4 mix(const float4& a, const float4& b, float t) {
        return make_float4(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z),
                           a.w + t * (b.w - a.w));
    }

    // Return the sum over the lanes up to and including this one.
    float sum_up_to(float x) const {
        for (int s = 1; s < 32; s *= 2) {
            const float before = __shfl_up_sync(0xffffffffu, x, s);
            x += lane >= s ? before : 0.0f;
        }
        return x;
    }

    // Find the raw density at this lane's position among the next 32.
    float look() {
        const int side = grid.density.shape[0], resolution = side - 1, plane = side * side;
        const int shift = __ffs(resolution / space.cells) - 1;  // log2 of an occupancy cell's side
        const float scale = (space.unbounded ? 0.25f : 0.5f) * (float)resolution;
        const float middle = 0.5f * (float)resolution, most = (float)resolution;
        const float finest = march.finest, cone = march.cone;
        t = first + (float)lane * finest;
        gap = finest;
        if (cone > 0.0f) {
            t = first;
            gap = fmaxf(finest, cone * t);
            for (int s = 0; s < lane; ++s) {
                t += gap;
                gap = fmaxf(finest, cone * t);
            }
        }
        first = __shfl_sync(0xffffffffu, t + gap, 31);
        float y[3] = {o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]};
        if (space.unbounded) {
            const float square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
            if (square > 1.0f) {
                const float r = rsqrtf(square), shrink = (2.0f - r) * r;
                for (int k = 0; k < 3; ++k) y[k] *= shrink;
            }
        }
        int i[3];
        for (int k = 0; k < 3; ++k) {
            const float g = fminf(fmaxf(y[k] * scale + middle, 0.0f), most);
            i[k] = min((int)g, resolution - 1);
            f[k] = g - (float)i[k];
        }
        node = (i[2] * side + i[1]) * side + i[0];
        const int cell =
            ((i[2] >> shift) * space.cells + (i[1] >> shift)) * space.cells + (i[0] >> shift);
        if (!(t < last && (space.bits.data[cell >> 5] >> (cell & 31) & 1u))) return -1e30f;
        const float* at = grid.density.data + node;
        const float a = at[0] + f[0] * (at[1] - at[0]);
        const float b = at[side] + f[0] * (at[side + 1] - at[side]);
        const float c = at[plane] + f[0] * (at[plane + 1] - at[plane]);
        const float e = at[plane + side] + f[0] * (at[plane + side + 1] - at[plane + side]);
        const float g = a + f[1] * (b - a), h = c + f[1] * (e - c);
        return g + f[2] * (h - g);
    }

    // Find the colours of visible samples.
    void paint() {
        const unsigned all = 0xffffffffu;
        const int side = grid.density.shape[0], plane = side * side;
        rgb[0] = rgb[1] = rgb[2] = 0.0f;
        for (unsigned todo = seen & own; __any_sync(all, todo); todo &= todo - 1) {
            const int s = __ffs(todo) - 1;  // -1 if none is left
            const int at = __shfl_sync(all, node, s);
            const float x = __shfl_sync(all, f[0], s), y = __shfl_sync(all, f[1], s);
            const float z = __shfl_sync(all, f[2], s);
            float sums[3] = {0.0f, 0.0f, 0.0f};
            if (todo) {
                const float4* row = (const float4*)grid.color.data + (size_t)at * each + part;
                const int up = side * each, in = plane * each;
                const float4 v0 = row[0], v1 = row[each], v2 = row[up], v3 = row[up + each];
                row += in;
                const float4 v4 = row[0], v5 = row[each], v6 = row[up], v7 = row[up + each];
                const float4 g = mix(mix(v0, v1, x), mix(v2, v3, x), y);
                const float4 h = mix(mix(v4, v5, x), mix(v6, v7, x), y);
                const float4 v = mix(g, h, z);
                for (int c = 0; c < 3; ++c)
                    sums[c] = v.x * bands[c][0] + v.y * bands[c][1] + v.z * bands[c][2] +
                              v.w * bands[c][3];
            }
            for (int k = 4; k; k /= 2)
                for (int c = 0; c < 3; ++c) {
                    const float more = __shfl_xor_sync(all, sums[c], k);
                    sums[c] += k < each ? more : 0.0f;
                }
            // Move the colour from the lanes that process a sample, beginning at `from`, to its
            // lane.
            const bool done = __shfl_sync(all, s, from) == lane;
            for (int c = 0; c < 3; ++c) {
                const float sum = __shfl_sync(all, sums[c], from);
                rgb[c] = done ? sum : rgb[c];
            }
        }
        for (int c = 0; c < 3; ++c) rgb[c] = 1.0f / (1.0f + expf(-rgb[c]));
    }

    // Move to the next 32 positions of which at least one is not empty, if there are any.
    bool next() {
        const unsigned all = 0xffffffffu;
        while (first < last && left > stop) {
            const float raw = look();
            const bool dense = raw > grid.least;
            if (!__any_sync(all, dense)) continue;
            sigma = dense ? expf(fminf(raw, MOST_LOG_DENSITY)) : 0.0f;
            const float alpha = 1.0f - expf(-sigma * gap);
            float through = 1.0f - alpha;  // product up to and including this sample
            for (int s = 1; s < 32; s *= 2) {
                const float before = __shfl_up_sync(all, through, s);
                through *= lane >= s ? before : 1.0f;
            }
            float before = __shfl_up_sync(all, through, 1);
            before = left * (lane ? before : 1.0f);
            const bool lit = dense && before > stop;
            w = lit ? before * alpha : 0.0f;
            behind = before - w;
            left *= __shfl_sync(all, through, 31);
            seen = __ballot_sync(all, lit);
            paint();
            const float upto_w = sum_up_to(w), upto_wt = sum_up_to(w * t);
            ahead_w = sum_w + upto_w - w;
            ahead_wt = sum_wt + upto_wt - w * t;
            sum_w += __shfl_sync(all, upto_w, 31);
            sum_wt += __shfl_sync(all, upto_wt, 31);
            return true;
        }
        return false;
    }
};
