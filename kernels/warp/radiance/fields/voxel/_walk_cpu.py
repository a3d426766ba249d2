"""What rays do on the CPU on their way through a grid of density and colour, in C.

A ray is walked 16 samples at a time: where they are, then their densities, then, for those that
are seen, the rows of colour coefficients round them, which are vectors of WIDTH numbers.
"""

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY
from cvkern.kernels.warp.radiance._harmonics import HARMONICS

from ._march import NAMES

# Numbers kept of a sample between the two halves of the backward pass: its cell, its place in it
# (3), and the gradients by its raw density and by the channels' sums of harmonics (3).
RECORD = 8

# e^x = 2^n e^f with |f| <= ln(2) / 2: the Taylor series of e^f up to f^7 is right within 1e-7.
# ln(2) is taken off in two parts, as n times the first of them is exact.
EXPONENTIAL = """
    const auto exponential = [](float x) {
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
    };
"""

# Of the ray's direction: bands[c] has the harmonics where the coefficients of channel c are.
BANDS = """
    const float* d = directions.data + 3 * (size_t)ray;
    float bands[3][WIDTH];
    {
        const float x = d[0], y = d[1], z = d[2];
        const float h[9] = {HARMONICS};
        for (int c = 0; c < 3; ++c) {
            for (int k = 0; k < WIDTH; ++k) bands[c][k] = 0.0f;
            for (int k = 0; k < basis; ++k) bands[c][c * basis + k] = h[k];
        }
    }
"""

# Up to 16 samples at a time. BEFORE, AFTER and END differ between the passes: AFTER does something
# with the `seen` samples of each batch.
WALK = """
    #pragma clang fp contract(fast)
    #pragma clang fp reassociate(on)
    NAMES
    EXPONENTIAL
    BANDS
    const int side = density.shape[0], resolution = side - 1, plane = side * side;
    const int shift = __builtin_ctz(resolution / cells);  // log2 of the side of an occupancy cell
    const float* o = origins.data + 3 * (size_t)ray;
    const float scale = (unbounded ? 0.25f : 0.5f) * (float)(resolution);
    const float middle = 0.5f * (float)(resolution), most = (float)(resolution);
    const float most_raw = MOST_LOG_DENSITY;
    const float block = (float)(1 << shift) / scale;  // the side of an occupancy cell
    const float inverse_gap = 1.0f / finest;
    float inverse[3], t = near, last = far;
    for (int k = 0; k < 3; ++k) {
        const float x = d[k] < 0.0f ? (d[k] > -1e-12f ? -1e-12f : d[k])
                                    : (d[k] < 1e-12f ? 1e-12f : d[k]);
        inverse[k] = 1.0f / x;
        if (!unbounded) {
            const float a = (-1.0f - o[k]) * inverse[k], b = (1.0f - o[k]) * inverse[k];
            const float enter = a < b ? a : b, leave = a < b ? b : a;
            t = enter > t ? enter : t;
            last = leave < last ? leave : last;
        }
    }
    {
        const float gap = cone * t;
        t += jitter * (gap > finest ? gap : finest);
    }
    float left = 1.0f;
    BEFORE
    while (t < last && left > stop) {
        int count = 0;
        int cells_at[3][16], node[16];
        float f[3][16], ts[16], gaps[16];
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
                f[k][count] = g - (float)(i[k]);
                cells_at[k][count] = i[k];
            }
            const int cell = ((i[2] >> shift) * cells + (i[1] >> shift)) * cells + (i[0] >> shift);
            if (bits.data[cell >> 5] >> (cell & 31) & 1u) {
                ts[count] = t;
                gaps[count] = gap;
                ++count;
                t += gap;
            } else if (unbounded) {
                t += gap;
            } else {  // by whole steps behind the cell
                float way = 1e30f;
                for (int k = 0; k < 3; ++k) {
                    const int to = (i[k] >> shift) + (inverse[k] > 0.0f);
                    const float along = ((float)(to) * block - 1.0f - y[k]) * inverse[k];
                    way = along < way ? along : way;
                }
                const float steps = __builtin_ceilf(way * inverse_gap);
                t += gap * (steps > 1.0f ? steps : 1.0f);
            }
        }
        if (count == 0) break;
        for (int s = count; s < 16; ++s) {
            for (int k = 0; k < 3; ++k) { cells_at[k][s] = 0; f[k][s] = 0.0f; }
            ts[s] = 0.0f;
            gaps[s] = 0.0f;
        }
        float alpha[16], raw[16], sigma[16];
        #pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < 16; ++s)
            node[s] = (cells_at[2][s] * side + cells_at[1][s]) * side + cells_at[0][s];
        #pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < 16; ++s) {
            const float* at = density.data + node[s];
            const float x = f[0][s], y = f[1][s], z = f[2][s];
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
            sigma[s] = raw[s] > least ? e : 0.0f;
            alpha[s] = 1.0f - exponential(-sigma[s] * gaps[s]);
        }
        float rgb[3][16], weight[16], behind[16];
        for (int s = 0; s < 16; ++s) {
            rgb[0][s] = rgb[1][s] = rgb[2][s] = 0.0f;
            weight[s] = 0.0f;
            behind[s] = 0.0f;
        }
        int seen = 0;  // the sample behind the last that light gets to
        for (int s = 0; s < count && left > stop; ++s) {
            seen = s + 1;
            if (sigma[s] <= 0.0f) continue;
            weight[s] = left * alpha[s];
            left -= weight[s];
            behind[s] = left;
            const float x = f[0][s], y = f[1][s], z = f[2][s];
            const float* row = color.data + (size_t)node[s] * WIDTH;
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
                const float v = (w0 * row[k] + w1 * row[k + WIDTH])
                    + (w2 * row_y[k] + w3 * row_y[k + WIDTH])
                    + (w4 * row_z[k] + w5 * row_z[k + WIDTH])
                    + (w6 * row_yz[k] + w7 * row_yz[k + WIDTH]);
                r += v * bands[0][k];
                g += v * bands[1][k];
                b += v * bands[2][k];
            }
            rgb[0][s] = r;
            rgb[1][s] = g;
            rgb[2][s] = b;
        }
        for (int c = 0; c < 3; ++c) {
            #pragma clang loop vectorize(assume_safety)
            for (int s = 0; s < 16; ++s) rgb[c][s] = 1.0f / (1.0f + exponential(-rgb[c][s]));
        }
        AFTER
    }
    END
"""

FORWARD = {
    "BEFORE": """
    float out[3] = {0.0f, 0.0f, 0.0f}, sum_w = 0.0f, sum_wt = 0.0f, spread = 0.0f;
    int found = 0;
    """,
    "AFTER": """
        for (int s = 0; s < seen; ++s) {
            const float w = weight[s];
            for (int c = 0; c < 3; ++c) out[c] += w * rgb[c][s];
            spread += w * (2.0f * (ts[s] * sum_w - sum_wt) + w * gaps[s] * (1.0f / 3.0f));
            sum_w += w;
            sum_wt += w * ts[s];
            found += sigma[s] > 0.0f;
        }
    """,
    "END": """
    for (int c = 0; c < 3; ++c) colors.data[3 * (size_t)ray + c] = out[c];
    opacity.data[ray] = sum_w;
    depth.data[ray] = sum_wt;
    distortion.data[ray] = spread;
    samples.data[ray] = found;
    """,
}

BACKWARD = {
    "BEFORE": """
    const float* dc = d_colors.data + 3 * (size_t)ray;
    const float d_o = d_opacity.data[ray], d_t = d_depth.data[ray], d_x = d_distortion.data[ray];
    const float all_w = opacity.data[ray], all_wt = depth.data[ray];
    float rest = d_o * all_w + d_t * all_wt + 2.0f * d_x * distortion.data[ray];
    for (int c = 0; c < 3; ++c) rest += dc[c] * colors.data[3 * (size_t)ray + c];
    float sum_w = 0.0f, sum_wt = 0.0f;
    float* record = records.data + (size_t)RECORD * begin;
    float* const end = record + (size_t)RECORD * room;
    """,
    "AFTER": """
        for (int s = 0; s < seen; ++s) {
            if (sigma[s] <= 0.0f || record == end) continue;
            const float w = weight[s], u = ts[s];
            float apart = u * sum_w - sum_wt;
            sum_w += w;
            sum_wt += w * u;
            apart += (all_wt - sum_wt) - u * (all_w - sum_w);
            float g = d_o + d_t * u + d_x * (2.0f * apart + (2.0f / 3.0f) * w * gaps[s]);
            for (int c = 0; c < 3; ++c) g += dc[c] * rgb[c][s];
            rest -= w * g;
            const int at = cells_at[0][s] | cells_at[1][s] << 10 | cells_at[2][s] << 20;
            record[0] = __builtin_bit_cast(float, at);
            for (int k = 0; k < 3; ++k) record[1 + k] = f[k][s];
            record[4] = sigma[s] * gaps[s] * (behind[s] * g - rest);
            for (int c = 0; c < 3; ++c)
                record[5 + c] = w * dc[c] * rgb[c][s] * (1.0f - rgb[c][s]);
            record += RECORD;
        }
    """,
    # Should the walk have ended sooner than it did in the forward pass, by a rounding.
    "END": """
    for (; record < end; ++record) *record = 0.0f;
    """,
}

# One in two (or four) of the planes (and lines) of the grid: no two threads add to the same node,
# and a node is added to in the order of the rays, whatever the number of threads.
SCATTER = """
    #pragma clang fp contract(fast)
    BANDS
    const int side = d_density.shape[0];
    const int own_z = owner & 1, own_y = owner >> 1;
    const float* record = records.data + (size_t)RECORD * begin;
    for (int s = 0; s < room; ++s, record += RECORD) {
        const int at = __builtin_bit_cast(int, record[0]);
        const int i = at & 1023, j0 = at >> 10 & 1023, k0 = at >> 20;
        const int far_z = (k0 ^ own_z) & 1;
        const float wz = far_z ? record[3] : 1.0f - record[3];
        const float d_raw = record[4], r = record[5], g = record[6], b = record[7];
        float row[WIDTH];
        #pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < WIDTH; ++k)
            row[k] = r * bands[0][k] + g * bands[1][k] + b * bands[2][k];
        for (int far_y = 0; far_y < 2; ++far_y) {
            if (owners == 4 && ((j0 + far_y) & 1) != own_y) continue;
            const float wyz = wz * (far_y ? record[2] : 1.0f - record[2]);
            const size_t node = ((size_t)(k0 + far_z) * side + (j0 + far_y)) * side + i;
            const float w0 = wyz * (1.0f - record[1]), w1 = wyz * record[1];
            d_density.data[node] += w0 * d_raw;
            d_density.data[node + 1] += w1 * d_raw;
            touched.data[node] = 1;
            touched.data[node + 1] = 1;
            float* to = d_color.data + node * WIDTH;
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < WIDTH; ++k) {
                const float near_k = to[k], far_k = to[k + WIDTH], v = row[k];
                to[k] = near_k + w0 * v;
                to[k + WIDTH] = far_k + w1 * v;
            }
        }
    }
"""


def text(template: str, width: int, parts: dict[str, str]) -> str:
    """Return the code for rows of one width."""
    shared = {
        "NAMES": NAMES,
        "EXPONENTIAL": EXPONENTIAL,
        "BANDS": BANDS,
        "RECORD": str(RECORD),
        "HARMONICS": ", ".join(HARMONICS[:9]),
        "MOST_LOG_DENSITY": f"{MOST_LOG_DENSITY}f",
    }
    for name, part in (parts | shared).items():
        template = template.replace(name, part)
    return template.replace("WIDTH", str(width))
