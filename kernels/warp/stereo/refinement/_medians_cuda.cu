// needs RADIUS, DOWN
void median(wp::array_t<float> disparity, wp::array_t<wp::uint8> guide, int contrast,
            wp::array_t<float> smooth) {
    const int height = disparity.shape[0], width = disparity.shape[1];
    const int pixel = blockIdx.x * blockDim.x + threadIdx.x, y = pixel / width, x = pixel % width;
    const int center = guide.data[pixel];
    float v[2 * RADIUS + 1];
    int weight[2 * RADIUS + 1], sum[2 * RADIUS + 1], total = 0;
#pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i) {
        const int v_at = DOWN ? min(max(y + i - RADIUS, 0), height - 1) : y;
        const int u_at = DOWN ? x : min(max(x + i - RADIUS, 0), width - 1);
        const int at = v_at * width + u_at;
        v[i] = __fadd_rn(disparity.data[at], 0.0f);
        weight[i] = v[i] == v[i] ? max(1, contrast - abs(guide.data[at] - center)) : 0;
        sum[i] = weight[i];
        total += weight[i];
    }
#pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i)
#pragma unroll
        for (int j = i + 1; j < 2 * RADIUS + 1; ++j) {
            const bool before = v[i] <= v[j];
            sum[j] += before ? weight[i] : 0;
            sum[i] += before ? 0 : weight[j];
        }
    float best = __int_as_float(0x7fc00000);
#pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i)
        if (weight[i] > 0 && 2 * sum[i] >= total && !(best <= v[i])) best = v[i];
    smooth.data[pixel] = best;
}
