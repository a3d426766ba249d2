#include "_bands.h"
#pragma once

// Up to 16 successive samples of a ray.
struct VoxelBatch {
    int count;  // samples of occupied cells
    int seen;   // the index after the last sample that light reaches
    int cells[3][16], node[16];
    float f[3][16];  // positions in their cells
    float t[16], gap[16], sigma[16];
    float weight[16], behind[16];  // w, and the light left after the sample
    float rgb[3][16];
};

// A ray's walk through a grid of density and colour.
struct VoxelWalk {
    const Space& space;
    const March& march;
    const Grid& grid;
    const float *o, *d;
    float stop, t, last, left, inverse[3];

    VoxelWalk(int ray, float jitter, const Rays& rays, const Space& space, const March& march,
              const Grid& grid, float stop)
        : space(space), march(march), grid(grid), stop(stop) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
        o = rays.origins.data + 3 * (size_t)ray;
        d = rays.directions.data + 3 * (size_t)ray;
        t = march.near;
        last = march.far;
        for (int k = 0; k < 3; ++k) {
            const float x =
                d[k] < 0.0f ? (d[k] > -1e-12f ? -1e-12f : d[k]) : (d[k] < 1e-12f ? 1e-12f : d[k]);
            inverse[k] = 1.0f / x;
            if (!space.unbounded) {
                const float a = (-1.0f - o[k]) * inverse[k], b = (1.0f - o[k]) * inverse[k];
                const float enter = a < b ? a : b, leave = a < b ? b : a;
                t = enter > t ? enter : t;
                last = leave < last ? leave : last;
            }
        }
        const float gap = march.cone * t;
        t += jitter * (gap > march.finest ? gap : march.finest);
        left = 1.0f;
    }

    // Return e^x = 2^n e^f with |f| <= ln(2) / 2. The Taylor series of e^f up to f^7 has an error
    // below 1e-7. n ln(2) is subtracted in two parts, the first of which is exact.
    static float exponential(float x) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
        x = x < -87.0f ? -87.0f : (x > 88.0f ? 88.0f : x);
        const float n = __builtin_floorf(x * 1.44269504f + 0.5f);
        const float f = (x - n * 0.693145752f) - n * 1.42860677e-6f;
        float e = 1.0f / 5040.0f;
        e = e * f + 1.0f / 720.0f;
        e = e * f + 1.0f / 120.0f;
        e = e * f + 1.0f / 24.0f;
        e = e * f + 1.0f / 6.0f;
        e = e * f + 0.5f;
        e = e * f + 1.0f;
        e = e * f + 1.0f;
        return e * __builtin_bit_cast(float, ((int)n + 127) << 23);
    }

    // Find up to 16 more positions in occupied cells.
    void find(VoxelBatch& batch) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
        const int resolution = grid.density.shape[0] - 1, cells = space.cells;
        const int shift = __builtin_ctz(resolution / cells);  // log2 of an occupancy cell's side
        const bool unbounded = space.unbounded;
        const float scale = (unbounded ? 0.25f : 0.5f) * (float)(resolution);
        const float middle = 0.5f * (float)(resolution), most = (float)(resolution);
        const float block = (float)(1 << shift) / scale;  // the side of an occupancy cell
        const float finest = march.finest, cone = march.cone, inverse_gap = 1.0f / finest;
        float t = this->t;
        int count = 0;
        while (count < 16 && t < last) {
            float gap = cone * t;
            gap = gap > finest ? gap : finest;
            float y[3] = {o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]};
            if (unbounded) {
                const float square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
                if (square > 1.0f) {
                    const float r = 1.0f / __builtin_sqrtf(square), shrink = (2.0f - r) * r;
                    for (int k = 0; k < 3; ++k) y[k] *= shrink;
                }
            }
            int i[3];
            for (int k = 0; k < 3; ++k) {
                float g = y[k] * scale + middle;
                g = g < 0.0f ? 0.0f : (g > most ? most : g);
                i[k] = (int)g < resolution ? (int)g : resolution - 1;
                batch.f[k][count] = g - (float)(i[k]);
                batch.cells[k][count] = i[k];
            }
            const int cell = ((i[2] >> shift) * cells + (i[1] >> shift)) * cells + (i[0] >> shift);
            if (space.bits.data[cell >> 5] >> (cell & 31) & 1u) {
                batch.t[count] = t;
                batch.gap[count] = gap;
                ++count;
                t += gap;
            } else if (unbounded) {
                t += gap;
            } else {  // by whole steps behind the cell
                float way = 1e30f;
                for (int k = 0; k < 3; ++k) {
                    const int to = (i[k] >> shift) + (inverse[k] > 0.0f);
                    const float along = ((float)(to)*block - 1.0f - y[k]) * inverse[k];
                    way = along < way ? along : way;
                }
                const float steps = __builtin_ceilf(way * inverse_gap);
                t += gap * (steps > 1.0f ? steps : 1.0f);
            }
        }
        this->t = t;
        batch.count = count;
        for (int s = count; s < 16; ++s) {
            for (int k = 0; k < 3; ++k) {
                batch.cells[k][s] = 0;
                batch.f[k][s] = 0.0f;
            }
            batch.t[s] = 0.0f;
            batch.gap[s] = 0.0f;
        }
    }

    // Process up to 16 more samples; return whether there are any.
    bool next(VoxelBatch& batch, const VoxelBands& bands) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
        if (!(t < last && left > stop)) return false;
        find(batch);
        if (batch.count == 0) return false;
        const int side = grid.density.shape[0], plane = side * side;
        const float least = grid.least, most_raw = MOST_LOG_DENSITY;
        const float* density = grid.density.data;
        float alpha[16], raw[16];
#pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < 16; ++s)
            batch.node[s] =
                (batch.cells[2][s] * side + batch.cells[1][s]) * side + batch.cells[0][s];
#pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < 16; ++s) {
            const float* at = density + batch.node[s];
            const float x = batch.f[0][s], y = batch.f[1][s], z = batch.f[2][s];
            const float v0 = at[0], v1 = at[1];
            const float v2 = at[side], v3 = at[side + 1];
            const float v4 = at[plane], v5 = at[plane + 1];
            const float v6 = at[plane + side], v7 = at[plane + side + 1];
            const float a = v0 + x * (v1 - v0), b = v2 + x * (v3 - v2);
            const float c = v4 + x * (v5 - v4), e = v6 + x * (v7 - v6);
            const float g = a + y * (b - a), h = c + y * (e - c);
            raw[s] = g + z * (h - g);
        }
#pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < 16; ++s) {
            const float e = exponential(raw[s] < most_raw ? raw[s] : most_raw);
            batch.sigma[s] = raw[s] > least ? e : 0.0f;
            alpha[s] = 1.0f - exponential(-batch.sigma[s] * batch.gap[s]);
        }
        for (int s = 0; s < 16; ++s) {
            batch.rgb[0][s] = batch.rgb[1][s] = batch.rgb[2][s] = 0.0f;
            batch.weight[s] = 0.0f;
            batch.behind[s] = 0.0f;
        }
        float left = this->left;
        int seen = 0;
        for (int s = 0; s < batch.count && left > stop; ++s) {
            seen = s + 1;
            if (batch.sigma[s] <= 0.0f) continue;
            batch.weight[s] = left * alpha[s];
            left -= batch.weight[s];
            batch.behind[s] = left;
            const float x = batch.f[0][s], y = batch.f[1][s], z = batch.f[2][s];
            const float* row = grid.color.data + (size_t)batch.node[s] * WIDTH;
            const float* row_y = row + (size_t)side * WIDTH;
            const float* row_z = row + (size_t)plane * WIDTH;
            const float* row_yz = row_z + (size_t)side * WIDTH;
            const float w0 = (1.0f - x) * (1.0f - y) * (1.0f - z), w1 = x * (1.0f - y) * (1.0f - z);
            const float w2 = (1.0f - x) * y * (1.0f - z), w3 = x * y * (1.0f - z);
            const float w4 = (1.0f - x) * (1.0f - y) * z, w5 = x * (1.0f - y) * z;
            const float w6 = (1.0f - x) * y * z, w7 = x * y * z;
            float r = 0.0f, g = 0.0f, b = 0.0f;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < WIDTH; ++k) {
                const float v = (w0 * row[k] + w1 * row[k + WIDTH]) +
                                (w2 * row_y[k] + w3 * row_y[k + WIDTH]) +
                                (w4 * row_z[k] + w5 * row_z[k + WIDTH]) +
                                (w6 * row_yz[k] + w7 * row_yz[k + WIDTH]);
                r += v * bands.of[0][k];
                g += v * bands.of[1][k];
                b += v * bands.of[2][k];
            }
            batch.rgb[0][s] = r;
            batch.rgb[1][s] = g;
            batch.rgb[2][s] = b;
        }
        this->left = left;
        batch.seen = seen;
        for (int c = 0; c < 3; ++c) {
#pragma clang loop vectorize(assume_safety)
            for (int s = 0; s < 16; ++s)
                batch.rgb[c][s] = 1.0f / (1.0f + exponential(-batch.rgb[c][s]));
        }
        return true;
    }
};
