#include "../../training/_adam_step.h"
#include "_touched.h"

// needs WIDTH
// One step of Adam at the touched nodes of plane k.
void adam_plane(int k, int side, wp::array_t<float> rate_density, wp::array_t<float> rate_color,
                wp::array_t<float> factor, AdamRule rule, wp::array_t<wp::uint8> touched,
                Learnt density, Learnt color) {
#pragma clang fp contract(fast)
    // Both means of squares have the same age.
    const Adam adam = {rule.beta1, rule.beta2, rule.epsilon, 1.0f / rate_color.data[2]};
    const float of_density = rate_density.data[0] / rate_density.data[1];
    const float of_color = rate_color.data[0] / rate_color.data[1], scale = factor.data[0];
    const size_t plane = (size_t)side * side;
    for (TouchedNodes at(touched.data, plane * k, plane * (k + 1)); at.next();) {
        const size_t node = at.node;
        touched.data[node] = 0;
        adam.step(density.gradients.data[node] * scale, density.mean.data[node],
                  density.square.data[node], density.weights.data[node], of_density);
        density.gradients.data[node] = 0.0f;
        float* gs = color.gradients.data + node * WIDTH;
        float* ms = color.mean.data + node * WIDTH;
        float* vs = color.square.data + node * WIDTH;
        float* ws = color.weights.data + node * WIDTH;
#pragma clang loop vectorize(assume_safety)
        for (int c = 0; c < WIDTH; ++c) {
            float m = ms[c], v = vs[c], w = ws[c];
            adam.step(gs[c] * scale, m, v, w, of_color);
            gs[c] = 0.0f;
            ms[c] = m;
            vs[c] = v;
            ws[c] = w;
        }
    }
}

// needs WIDTH
// Gradients of squares of differences at the touched nodes of plane k.
void variation_plane(int k, float weight_density, float weight_color,
                     wp::array_t<wp::uint8> touched, wp::array_t<float> density,
                     wp::array_t<float> color, wp::array_t<float> d_density,
                     wp::array_t<float> d_color) {
#pragma clang fp contract(fast)
    const int side = density.shape[0];
    const size_t plane = (size_t)side * side, begin = plane * k;
    for (TouchedNodes touching(touched.data, begin, begin + plane); touching.next();) {
        const size_t node = touching.node;
        const int j = (int)((node - begin) / side), i = (int)((node - begin) % side);
        // A neighbour outside the grid counts as equal.
        const long long to[6] = {i > 0 ? -1 : 0,
                                 i + 1 < side ? 1 : 0,
                                 j > 0 ? -side : 0,
                                 j + 1 < side ? side : 0,
                                 k > 0 ? -(long long)plane : 0,
                                 k + 1 < side ? (long long)plane : 0};
        {
            const float* at = density.data + node;
            float sum = 6.0f * at[0];
            for (int n = 0; n < 6; ++n) sum -= at[to[n]];
            d_density.data[node] += weight_density * sum;
        }
        const float* at = color.data + node * WIDTH;
        const float *a = at + to[0] * WIDTH, *b = at + to[1] * WIDTH, *c = at + to[2] * WIDTH;
        const float *d = at + to[3] * WIDTH, *e = at + to[4] * WIDTH, *f = at + to[5] * WIDTH;
        float* out = d_color.data + node * WIDTH;
#pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < WIDTH; ++x)
            out[x] +=
                weight_color * (6.0f * at[x] - ((a[x] + b[x]) + (c[x] + d[x]) + (e[x] + f[x])));
    }
}
