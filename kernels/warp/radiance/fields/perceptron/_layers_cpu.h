// needs LANES
// For LANES columns at a time: sum over k of src[row, k] w[k, n].
void multiply(int first, int last, wp::array_t<float> src, wp::array_t<float> w,
              wp::array_t<float> gates, wp::array_t<int> total, Product product,
              wp::array_t<float> dst) {
#pragma clang fp contract(fast)
    const int rows = total.data[0] < last ? total.data[0] : last;
    const int pitch = w.shape[1], pitch_in = src.shape[1], pitch_out = dst.shape[1];
    const int depth = w.shape[0], columns = product.columns;
    const bool relu = product.relu, gated = product.gated;
    for (int row = first; row < rows; ++row) {
        const float* x = src.data + (size_t)row * pitch_in + product.column_in;
        float* to = dst.data + (size_t)row * pitch_out + product.column_out;
        const float* gate = gates.data + (size_t)row * gates.shape[1];
        for (int n0 = 0; n0 < columns; n0 += LANES) {
            float sums[LANES];
#pragma clang loop vectorize(assume_safety)
            for (int n = 0; n < LANES; ++n) sums[n] = 0.0f;
            for (int k = 0; k < depth; ++k) {
                const float* weights = w.data + (size_t)k * pitch + n0;
                const float value = x[k];
#pragma clang loop vectorize(assume_safety) interleave(enable)
                for (int n = 0; n < LANES; ++n) sums[n] += value * weights[n];
            }
            const int count = columns - n0 < LANES ? columns - n0 : LANES;
            if (relu)
                for (int n = 0; n < LANES; ++n) sums[n] = sums[n] > 0.0f ? sums[n] : 0.0f;
            if (gated)
                for (int n = 0; n < count; ++n) sums[n] = gate[n0 + n] > 0.0f ? sums[n] : 0.0f;
            for (int n = 0; n < count; ++n) to[n0 + n] = sums[n];
        }
    }
}

// needs LANES, ROWS
// For ROWS samples at a time: sum over them of src[row, k] dy[row, n].
void accumulate(int slab, int first, int last, wp::array_t<float> dy, wp::array_t<float> src,
                wp::array_t<int> total, int column, int columns, wp::array_t<float> parts) {
#pragma clang fp contract(fast)
    const int rows = total.data[0] < last ? total.data[0] : last;
    const int depth = parts.shape[1], padded = parts.shape[2];
    const int pitch = dy.shape[1], pitch_in = src.shape[1];
    float* own = parts.data + (size_t)slab * depth * padded;
    for (int i = 0; i < depth * padded; ++i) own[i] = 0.0f;
    for (int begin = first; begin < rows; begin += ROWS) {
        const int count = rows - begin < ROWS ? rows - begin : ROWS;
        for (int n0 = 0; n0 < columns; n0 += LANES) {
            float ys[ROWS * LANES];
            const int wide = columns - n0 < LANES ? columns - n0 : LANES;
            const float* from = dy.data + (size_t)begin * pitch + column + n0;
            for (int s = 0; s < count; ++s)
                for (int n = 0; n < LANES; ++n)
                    ys[LANES * s + n] = n < wide ? from[(size_t)s * pitch + n] : 0.0f;
            for (int k = 0; k < depth; ++k) {
                float* to = own + (size_t)k * padded + n0;
                float sums[LANES];
#pragma clang loop vectorize(assume_safety)
                for (int n = 0; n < LANES; ++n) sums[n] = to[n];
                for (int s = 0; s < count; ++s) {
                    const float value = src.data[(size_t)(begin + s) * pitch_in + k];
#pragma clang loop vectorize(assume_safety)
                    for (int n = 0; n < LANES; ++n) sums[n] += value * ys[LANES * s + n];
                }
#pragma clang loop vectorize(assume_safety)
                for (int n = 0; n < LANES; ++n) to[n] = sums[n];
            }
        }
    }
}
