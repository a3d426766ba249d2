// needs RADIUS, DOWN
// Weighted medians of two neighbouring windows, along the rows or down the columns. Both pixels
// compare the same pairs of values. Weights and their sums are whole numbers, exact as floats.
void median(wp::array_t<float> disparity, wp::array_t<wp::uint8> guide, int contrast,
            wp::array_t<float> smooth) {
    enum { SIZE = 2 * RADIUS + 1 };
    const int height = disparity.shape[0], width = disparity.shape[1];
    const int across = DOWN ? width : (width + 1) / 2;
    const unsigned item = blockIdx.x * blockDim.x + threadIdx.x;
    const unsigned row = item / across;
    if (row >= (unsigned)(DOWN ? (height + 1) / 2 : height)) return;
    const int y = DOWN ? 2 * row : row, x = (DOWN ? 1 : 2) * (item - row * across);
    const int last = DOWN ? height - 1 : width - 1, begin = DOWN ? y : x;
    const size_t step = DOWN ? width : 1;
    const float* const from = disparity.data + (DOWN ? (size_t)x : (size_t)y * width);
    const wp::uint8* const grays = guide.data + (DOWN ? (size_t)x : (size_t)y * width);
    float value[SIZE + 1], weight[2][SIZE], sum[2][SIZE], total[2] = {0.0f, 0.0f};
    int gray[SIZE + 1];
#pragma unroll
    for (int i = 0; i < SIZE + 1; ++i) {
        const size_t place = max(0, min(last, begin + i - RADIUS)) * step;
        value[i] = from[place] + 0.0f;  // no -0
        gray[i] = grays[place];
    }
#pragma unroll
    for (int p = 0; p < 2; ++p) {
#pragma unroll
        for (int i = 0; i < SIZE; ++i) {
            const int alike = max(1, contrast - abs(gray[p + i] - gray[p + RADIUS]));
            weight[p][i] = value[p + i] == value[p + i] ? (float)alike : 0.0f;
            sum[p][i] = weight[p][i];
            total[p] += weight[p][i];
        }
    }
#pragma unroll
    for (int i = 0; i < SIZE + 1; ++i) {
#pragma unroll
        for (int j = i + 1; j < SIZE + 1; ++j) {
            const bool before = value[i] <= value[j];
#pragma unroll
            for (int p = 0; p < 2; ++p) {
                if (i < p || j >= SIZE + p) continue;
                if (before)
                    sum[p][j - p] += weight[p][i - p];
                else
                    sum[p][i - p] += weight[p][j - p];
            }
        }
    }
#pragma unroll
    for (int p = 0; p < 2; ++p) {
        if (begin + p > last) break;
        float best = __int_as_float(0x7fc00000);
#pragma unroll
        for (int i = 0; i < SIZE; ++i) {
            const bool reaches = weight[p][i] > 0.0f && 2.0f * sum[p][i] >= total[p];
            if (reaches && !(best <= value[p + i])) best = value[p + i];
        }
        smooth.data[(size_t)(DOWN ? y + p : y) * width + (DOWN ? x : x + p)] = best;
    }
}
