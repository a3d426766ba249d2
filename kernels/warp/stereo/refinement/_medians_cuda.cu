// needs RADIUS, DOWN, NUMBER, BITS
// Weighted medians of two neighbouring windows, along the rows or down the columns. Both compare
// the same values; the halves of a NUMBER, of BITS each, hold their weights and sums of these. A
// value that only one of them has weighs nothing in the other.
void median(wp::array_t<float> disparity, wp::array_t<wp::uint8> guide, int contrast,
            wp::array_t<float> smooth) {
    enum { SIZE = 2 * RADIUS + 1 };
    const NUMBER MOST = ((NUMBER)1 << BITS) - 1;
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
    float value[SIZE + 1];
    int gray[SIZE + 1];
    NUMBER weight[SIZE + 1], sum[SIZE + 1], total = 0;
#pragma unroll
    for (int i = 0; i < SIZE + 1; ++i) {
        const size_t place = max(0, min(last, begin + i - RADIUS)) * step;
        value[i] = from[place] + 0.0f;  // no -0
        gray[i] = grays[place];
    }
#pragma unroll
    for (int i = 0; i < SIZE + 1; ++i) {
        const int one = max(1, contrast - abs(gray[i] - gray[RADIUS]));
        const int other = max(1, contrast - abs(gray[i] - gray[RADIUS + 1]));
        const NUMBER both = (NUMBER)(i < SIZE ? one : 0) | (NUMBER)(i > 0 ? other : 0) << BITS;
        weight[i] = value[i] == value[i] ? both : 0;
        total += weight[i];
    }
    // The sum of a value is the weight of those before or equal to it. It begins with the weights
    // from its own place on.
    NUMBER rest = 0;
#pragma unroll
    for (int i = SIZE; i >= 0; --i) sum[i] = rest += weight[i];
#pragma unroll
    for (int i = 0; i < SIZE + 1; ++i) {
#pragma unroll
        for (int j = i + 1; j < SIZE + 1; ++j) {
            if (value[i] <= value[j]) {
                sum[i] -= weight[j];
                sum[j] += weight[i];
            }
        }
    }
#pragma unroll
    for (int p = 0; p < 2; ++p) {
        if (begin + p > last) break;
        // The least sum that reaches half of the total; of the high half, the low one cannot matter.
        const NUMBER half = ((total >> BITS * p & MOST) + 1) / 2;
        float best = __int_as_float(0x7fc00000);
#pragma unroll
        for (int i = p; i < SIZE + p; ++i) {
            const bool reaches = p ? sum[i] >= half << BITS : (sum[i] & MOST) >= half;
            if (reaches) best = fminf(best, value[i]);  // NaN weighs nothing, and is never less
        }
        smooth.data[(size_t)(DOWN ? y + p : y) * width + (DOWN ? x : x + p)] = best;
    }
}
