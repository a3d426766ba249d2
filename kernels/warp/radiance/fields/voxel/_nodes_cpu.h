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
