#include "../../training/_adam_step.h"
#include "_touched.cu"

// needs NODES, BLOCK
// Gradients of squares of differences at touched nodes.
void smooth(int thread, float weight_density, float weight_color, wp::array_t<wp::uint8> touched,
            wp::array_t<float> density, wp::array_t<float> color, int side, int width,
            wp::array_t<float> d_density, wp::array_t<float> d_color) {
    const TouchedNodes nodes(touched.data, touched.shape[0], thread);
    if (nodes.count == 0) return;
    auto add_up = [&](int at, auto add) {
        for (int axis = 0, jump = 1; axis < 3; ++axis, jump *= side) {
            const int place = at / jump % side;
            add(place > 0 ? -jump : 0);  // a neighbour outside the grid counts as equal
            add(place + 1 < side ? jump : 0);
        }
    };
    for (int n = threadIdx.x; n < nodes.count; n += BLOCK) {
        const int node = nodes.begin + nodes.found[n];
        const float* at = density.data + node;
        float sum = 0.0f;
        add_up(node, [&](int jump) { sum += at[0] - at[jump]; });
        d_density.data[node] += weight_density * sum;
    }
    const int each = width / 4, part = threadIdx.x % each;  // threads of a row of coefficients
    for (int n = threadIdx.x / each; n < nodes.count; n += BLOCK / each) {
        const int node = nodes.begin + nodes.found[n], i = node * each + part;
        const float4* at = (const float4*)color.data + i;
        const float4 v = at[0];
        float4 sum = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        add_up(node, [&](int jump) {
            const float4 u = at[jump * each];
            sum.x += v.x - u.x;
            sum.y += v.y - u.y;
            sum.z += v.z - u.z;
            sum.w += v.w - u.w;
        });
        float4& slope = ((float4*)d_color.data)[i];
        float4 g = slope;
        g.x += weight_color * sum.x;
        g.y += weight_color * sum.y;
        g.z += weight_color * sum.z;
        g.w += weight_color * sum.w;
        slope = g;
    }
}

// needs NODES, BLOCK
// One step of Adam at touched nodes.
void move(int thread, wp::array_t<float> rate_density, wp::array_t<float> rate_color,
          wp::array_t<float> factor, AdamRule rule, int width, wp::array_t<wp::uint8> touched,
          Learnt density, Learnt color) {
    const TouchedNodes nodes(touched.data, touched.shape[0], thread);
    if (nodes.count == 0) return;
    const float of_density = rate_density.data[0] / rate_density.data[1];
    const float of_color = rate_color.data[0] / rate_color.data[1], scale = factor.data[0];
    // Both means of squares have the same age.
    const Adam adam = {rule.beta1, rule.beta2, rule.epsilon, 1.0f / rate_color.data[2]};
    for (int n = threadIdx.x; n < nodes.count; n += BLOCK) {
        const int node = nodes.begin + nodes.found[n];
        touched.data[node] = 0;
        adam.step(density.gradients.data[node] * scale, density.mean.data[node],
                  density.square.data[node], density.weights.data[node], of_density);
        density.gradients.data[node] = 0.0f;
    }
    const int each = width / 4, part = threadIdx.x % each;  // threads of a row of coefficients
    for (int n = threadIdx.x / each; n < nodes.count; n += BLOCK / each) {
        const int i = (nodes.begin + nodes.found[n]) * each + part;
        const float4 g = ((float4*)color.gradients.data)[i];
        float4 m = ((float4*)color.mean.data)[i];
        float4 v = ((float4*)color.square.data)[i];
        float4 w = ((float4*)color.weights.data)[i];
        adam.step(g.x * scale, m.x, v.x, w.x, of_color);
        adam.step(g.y * scale, m.y, v.y, w.y, of_color);
        adam.step(g.z * scale, m.z, v.z, w.z, of_color);
        adam.step(g.w * scale, m.w, v.w, w.w, of_color);
        ((float4*)color.gradients.data)[i] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        ((float4*)color.mean.data)[i] = m;
        ((float4*)color.square.data)[i] = v;
        ((float4*)color.weights.data)[i] = w;
    }
}
