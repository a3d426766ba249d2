// needs BLOCK, BINS, L1
// Count the digits of the values of some pixels of an image in shared memory; _quantiles.py has the
// rule.
void count_pixels(wp::array_t<float> dy, wp::array_t<float> dx, int norm, int level, int shift,
                  int width, wp::array_t<int> found, wp::array_t<int> counts,
                  wp::array_t<int> most) {
    __shared__ int own[2 * BINS];
    const int images = most.shape[0], parts = gridDim.x / images, image = blockIdx.x / parts;
    const int part = blockIdx.x - image * parts;
    const int pixels = dy.shape[0] / images * dy.shape[1], bins = 1 << width;
    const int one = found.data[4 * image], two = found.data[4 * image + 2];
    const float *down = dy.data + (size_t)image * pixels, *along = dx.data + (size_t)image * pixels;
    for (int k = threadIdx.x; k < 2 * BINS; k += BLOCK) own[k] = 0;
    __syncthreads();
    int largest = 0;
    for (int i = part * BLOCK + threadIdx.x; i < pixels; i += parts * BLOCK) {
        const float y = down[i], x = along[i];
        const float m = norm == L1 ? __fadd_rn(fabsf(x), fabsf(y))
                                   : __fadd_rn(__fmul_rn(x, x), __fmul_rn(y, y));
        const int bits = m > 0.0f ? __float_as_int(m) : 0;
        const int digit = (bits >> shift) & (bins - 1), above = bits >> (shift + width);
        largest = max(largest, bits);
        if (level == 0 || above == one) atomicAdd(own + digit, 1);
        if (level != 0 && above == two) atomicAdd(own + BINS + digit, 1);
    }
    for (int apart = 16; apart; apart /= 2)
        largest = max(largest, __shfl_xor_sync(~0u, largest, apart));
    if (threadIdx.x % 32 == 0) atomicMax(most.data + image, largest);
    __syncthreads();
    for (int k = threadIdx.x; k < 2 * BINS; k += BLOCK)
        if (own[k]) atomicAdd(counts.data + (size_t)image * 2 * BINS + k, own[k]);
}

// needs BLOCK, BINS
// Choose the digit of a rank, a block of threads a rank.
void choose(wp::array_t<int> counts, int level, int width, wp::array_t<int> found) {
    __shared__ int sums[BLOCK / 32], digit, passed;
    const int i = blockIdx.x, thread = threadIdx.x, lane = thread % 32;
    const int each = ((1 << width) + BLOCK - 1) / BLOCK, rank = found.data[2 * i + 1];
    const int first = min(thread * each, 1 << width), last = min(first + each, 1 << width);
    // Both thresholds use the same counts of the first digit.
    const int* row = counts.data + (size_t)(level ? i : i & ~1) * BINS;
    int count = 0;
    for (int k = first; k < last; ++k) count += row[k];
    int sum = count;
    for (int apart = 1; apart < 32; apart *= 2) {
        const int other = __shfl_up_sync(~0u, sum, apart);
        if (lane >= apart) sum += other;
    }
    if (lane == 31) sums[thread / 32] = sum;
    if (thread == 0) digit = passed = 0;
    __syncthreads();
    int below = sum - count;
    for (int w = 0; w < thread / 32; ++w) below += sums[w];
    int number = 0, most = 0;
    for (int k = first; k < last; ++k) {
        below += row[k];
        if (below <= rank) ++number, most = below;
    }
    atomicAdd(&digit, number);
    atomicMax(&passed, most);
    __syncthreads();
    if (thread) return;
    found.data[2 * i] = (found.data[2 * i] << width) | digit;
    found.data[2 * i + 1] = rank - passed;
}
