// needs SPREAD, LARGEST, WHITE
// Cut out a patch and normalise it, a warp a patch; patches.py has the rule.
void sample(wp::array_t<float> image, wp::array_t<int> corners, int side, wp::int64 least,
            wp::array_t<wp::int8> patches) {
    const int i = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (i >= corners.shape[0]) return;
    const int size = patches.shape[1], count = side * side;
    const size_t width = corners.data[2 * i + 1];
    const float* from = image.data + corners.data[2 * i];
    // Each lane has at most 20 pixels of 25 x 25.
    const auto pixel = [&](int k) {
        const float value = from[(size_t)(k / side) * width + k % side];
        const float cut = fminf(fmaxf(value, 0.0f), 1.0f);
        return (int)floorf(__fadd_rn(__fmul_rn(cut, (float)WHITE), 0.5f));
    };
    int total = 0;
    unsigned int squares = 0;
    for (int k = lane; k < count; k += 32) {
        const int x = pixel(k);
        total += x;
        squares += x * x;
    }
    unsigned long long wide = squares;
    for (int apart = 16; apart; apart /= 2) {
        total += __shfl_xor_sync(~0u, total, apart);
        wide += __shfl_xor_sync(~0u, wide, apart);
    }
    const long long square = count * (long long)wide - (long long)total * total;
    long long root = (long long)sqrt((double)square);
    while (root * root > square) --root;
    while ((root + 1) * (root + 1) <= square) ++root;
    const double scale = (double)SPREAD / (double)(root > 1 ? root : 1);
    wp::int8* out = patches.data + (size_t)i * size;
    for (int k = lane; k < size; k += 32) {
        int value = 0;
        if (k < count && root >= least) {
            const double x = (double)(count * pixel(k) - total);
            value = (int)floor(__dadd_rn(__dmul_rn(x, scale), 0.5 + 0x1p-30));
        }
        out[k] = (wp::int8)min(max(value, -LARGEST), LARGEST);
    }
}
