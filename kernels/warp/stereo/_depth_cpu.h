void depth(int slab, int first, int last, wp::array_t<float> disparity, float scale, float doffs,
           wp::array_t<float> depth) {
    const int columns = depth.shape[1];
    const float* from = disparity.data;
    float* to = depth.data;
    const float infinite = __builtin_inff(), none = __builtin_nanf("");
    const size_t end = (size_t)last * columns;
#pragma clang loop vectorize(assume_safety)
    for (size_t i = (size_t)first * columns; i < end; ++i) {
        const float sum = from[i] + doffs;
        const float beyond = sum == 0.0f ? infinite : none;
        const float quotient = scale / sum;
        to[i] = sum > 0.0f && sum < infinite ? quotient : beyond;
    }
}

// Products and sums are in the order of `mapped` in _depth_cuda.py, and none of them is fused.
void points(int slab, int first, int last, wp::array_t<float> disparity, wp::array_t<float> q,
            wp::array_t<float> points) {
    const int columns = points.shape[1];
    const float none = __builtin_nanf(""), infinite = __builtin_inff();
    float m[16];
    for (int i = 0; i < 16; ++i) m[i] = q.data[i];
    for (int row = first; row < last; ++row) {
        const float* from = disparity.data + (size_t)row * columns;
        float* to = points.data + (size_t)row * columns * 3;
        const float y = (float)row;
#pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < columns; ++x) {
            const float d = from[x], u = (float)x;
            const float a = m[0] * u + m[1] * y + m[2] * d + m[3];
            const float b = m[4] * u + m[5] * y + m[6] * d + m[7];
            const float c = m[8] * u + m[9] * y + m[10] * d + m[11];
            const float w = m[12] * u + m[13] * y + m[14] * d + m[15];
            const bool exists = __builtin_fabsf(d) < infinite && w != 0.0f;
            const float p = a / w, s = b / w, t = c / w;
            to[3 * x] = exists ? p : none;
            to[3 * x + 1] = exists ? s : none;
            to[3 * x + 2] = exists ? t : none;
        }
    }
}
