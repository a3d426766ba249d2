#include "_network.cu"

// needs INPUTS, COLOR, LIT, Sides, MOST_LOG_DENSITY
// Densities and colours from features, and from lights if LIT.
void pass_on(wp::array_t<wp::half> features, Sides sides, wp::array_t<int> total,
             wp::array_t<wp::half> weights, wp::array_t<float> sigma, wp::array_t<float> rgb) {
    const Network net(weights.data, total.data[0]);
    const int warps = blockDim.x >> 5, stride = gridDim.x * warps * 16, t = net.t;
    for (int row = (blockIdx.x * warps + net.warp) * 16 + net.g; row - net.g < net.rows;
         row += stride) {
        Network::Values v;
        net.density_layers(v, features.data, row);
        net.write_sigma(sigma.data, v, row);
        if (LIT)
            net.light(v.hidden[1 + LIT], sides.table.data, sides.views.data, sides.rays.data, row);
        net.color_layers(v, sides.directions.data, sides.rays.data, row);
        float raw[2][4];
        net.multiply(raw, 2, v.third, 4, net.layers + Network::IN4, Network::NARROW);
        for (int half = 0; half < 2; ++half)
            for (int j = 0; j < 2; ++j)
                if (2 * t + j < 3 && row + 8 * half < net.rows)
                    rgb.data[3 * (size_t)(row + 8 * half) + 2 * t + j] =
                        1.0f / (1.0f + expf(-raw[0][2 * half + j]));
    }
}

// needs INPUTS, COLOR, LIT, MOST_LOG_DENSITY
// Only densities.
void pass_density(wp::array_t<wp::half> features, wp::array_t<int> total,
                  wp::array_t<wp::half> weights, wp::array_t<float> sigma) {
    const Network net(weights.data, total.data[0]);
    const int warps = blockDim.x >> 5, stride = gridDim.x * warps * 16;
    for (int row = (blockIdx.x * warps + net.warp) * 16 + net.g; row - net.g < net.rows;
         row += stride) {
        Network::Values v;
        net.density_layers(v, features.data, row);
        net.write_sigma(sigma.data, v, row);
    }
}
