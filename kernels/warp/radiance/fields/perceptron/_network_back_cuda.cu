#include "_network_back.cu"

// needs INPUTS, COLOR, LIT, Sides, MOST_LOG_DENSITY, MOST_LOG_DENSITY_GRADIENT
// All gradients: those of features, those of the light of each sample if LIT, and those of weights,
// one part per block. Each warp sums 16 columns of layers that have 64, and 16 rows of layers that
// have 16.
void pass_back(wp::array_t<float> d_sigma, wp::array_t<float> d_rgb, wp::array_t<wp::half> features,
               Sides sides, wp::array_t<int> total, wp::array_t<wp::half> weights,
               wp::array_t<float> sigma, wp::array_t<float> rgb, wp::array_t<wp::half> d_features,
               wp::array_t<float> d_lights, wp::array_t<float> parts) {
    const Network net(weights.data, total.data[0]);
    const NetworkBack back(net);
    const int t = net.t, rows = net.rows, own = 16 * net.warp;
    constexpr int WIDE = Network::WIDE, NARROW = Network::NARROW, INS = INPUTS / 16;
    constexpr int HIDDEN = Network::HIDDEN;
    const float most_up = MOST_LOG_DENSITY_GRADIENT;
    float dw0[INS][2][4] = {}, dw1[1][2][4] = {}, dw2[HIDDEN][2][4] = {};
    float dw3[4][2][4] = {}, dw4[1][2][4] = {};
    for (int begin = blockIdx.x * 64; begin < rows; begin += gridDim.x * 64) {
        const int row = begin + own + net.g;
        // With s = exp(h), ds/dh = s; with c = 1 / (1 + exp(-r)), dc/dr = c (1 - c).
        unsigned int d_raw[1][4] = {}, d_third[4][4], d_second[4][4];
        unsigned int d_hidden[1][4], d_first[4][4];
        float up[2] = {};
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            const int line = row + 8 * half;
            if (line >= rows) continue;
            float d[2] = {};
            for (int j = 0; j < 2; ++j)
                if (2 * t + j < 3) {
                    const size_t at = 3 * (size_t)line + 2 * t + j;
                    d[j] = d_rgb.data[at] * rgb.data[at] * (1.0f - rgb.data[at]);
                }
            d_raw[0][half] = TensorCores::pack(d[0], d[1]);
            if (t == 0) {
                const float d = d_sigma.data[line] * sigma.data[line];
                up[half] = fabsf(d) > most_up ? copysignf(most_up, d) : d;  // a NaN stays
            }
        }
        Network::Values v;
        net.density_layers(v, features.data, row);
        if (LIT)
            net.light(v.hidden[1 + LIT], sides.table.data, sides.views.data, sides.rays.data, row);
        net.color_layers(v, sides.directions.data, sides.rays.data, row);
        back.share(v.third, 4, d_raw, 1);
        back.multiply(v.wide, 8, d_raw, 1, net.layers + Network::IN4, NARROW);
        back.gated(d_third, 4, v.wide, v.third);
        back.add(dw4, 1, own, 0);
        back.share(v.second, 4, d_third, 4);
        back.multiply(v.wide, 8, d_third, 4, net.layers + Network::IN3, WIDE);
        back.gated(d_second, 4, v.wide, v.second);
        back.add(dw3, 4, 0, own);
        back.share(v.hidden, HIDDEN, d_second, 4);
        // The viewing direction needs no gradient.
        back.multiply(v.density, 2, d_second, 4, net.layers + Network::IN2, WIDE);
        v.density[0][0] += up[0];
        v.density[0][2] += up[1];
        net.operand(d_hidden, 1, v.density);
        back.add(dw2, HIDDEN, 0, own);
        if (LIT) {
            back.multiply(v.density, 2, d_second, 4, net.layers + Network::IN2 + 32 * WIDE, WIDE);
#pragma unroll
            for (int i = 0; i < 8; ++i) {
                const int line = row + i / 2 % 2 * 8;
                const int k = i / 4 * 8 + 2 * t + i % 2;
                if (line < rows) d_lights.data[16 * (size_t)line + k] = v.density[i / 4][i % 4];
            }
        }
        back.share(v.first, 4, d_hidden, 1);
        back.multiply(v.wide, 8, d_hidden, 1, net.layers + Network::IN1, NARROW);
        back.gated(d_first, 4, v.wide, v.first);
        back.add(dw1, 1, own, 0);
        back.share(v.x, INS, d_first, 4);
        float sums[2 * INS][4];
        back.multiply(sums, 2 * INS, d_first, 4, net.layers, WIDE);
        net.operand(v.x, INS, sums);
#pragma unroll
        for (int k = 0; k < INS; ++k)
#pragma unroll
            for (int i = 0; i < 4; ++i) {
                const int line = row + i % 2 * 8;
                const size_t at = (size_t)line * INPUTS + 16 * k + i / 2 * 8 + 2 * t;
                if (line < rows)
                    *(unsigned int*)((unsigned short*)d_features.data + at) = v.x[k][i];
            }
        back.add(dw0, INS, 0, own);
    }
    float* part = parts.data + (size_t)blockIdx.x * parts.shape[1];
    back.write(part, dw0, INS, 64, 0, own);
    back.write(part + Network::AT1, dw1, 1, 16, own, 0);
    back.write(part + Network::AT2, dw2, HIDDEN, 64, 0, own);
    back.write(part + Network::AT3, dw3, 4, 64, 0, own);
    back.write(part + Network::AT4, dw4, 1, 16, own, 0);
}
