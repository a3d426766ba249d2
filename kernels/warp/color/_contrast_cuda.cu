// Histograms on CUDA. A block counts in shared memory, and adds its counts to those of all. Equal
// neighbours are counted together: most pictures are smooth, and atomics on one place wait in turn.
// Places fit an int: the API takes at most 2^29 values.

// A thread has GROUP levels at once. Without BINS, there are too many for shared memory.
// needs LEVEL, BINS, GROUP
void count_levels(wp::array_t<LEVEL> found, wp::array_t<int> counts) {
    struct alignas(16) Part {
        LEVEL v[16 / sizeof(LEVEL)];
    };
    enum { SIDE = 16 / sizeof(LEVEL), PARTS = GROUP / SIDE };
    __shared__ int own[BINS ? BINS : 1];
    int* const to = BINS ? own : counts.data;
    for (int i = threadIdx.x; i < BINS; i += blockDim.x) own[i] = 0;
    __syncthreads();
    const int size = found.shape[0];
    const bool aligned = ((size_t)found.data & 15) == 0;
    for (int i = GROUP * (blockIdx.x * blockDim.x + threadIdx.x); i < size;
         i += GROUP * gridDim.x * blockDim.x) {
        Part parts[PARTS];
        const int some = size - i < GROUP ? size - i : GROUP;
        if (aligned && some == GROUP) {
#pragma unroll
            for (int k = 0; k < PARTS; ++k) parts[k] = ((const Part*)(found.data + i))[k];
        } else {
#pragma unroll
            for (int k = 0; k < GROUP; ++k)
                parts[k / SIDE].v[k % SIDE] = found.data[i + (k < some ? k : 0)];
        }
        int level = parts[0].v[0], number = 0;
#pragma unroll
        for (int k = 0; k < GROUP; ++k) {
            const int next = parts[k / SIDE].v[k % SIDE];
            if (k >= some) continue;
            if (next != level) {
                atomicAdd(to + level, number);
                level = next;
                number = 0;
            }
            ++number;
        }
        atomicAdd(to + level, number);
    }
    __syncthreads();
    for (int i = threadIdx.x; i < BINS; i += blockDim.x)
        if (own[i]) atomicAdd(counts.data + i, own[i]);
}

// Bins between edges: a guess, which the edges then correct.
// needs BINS
void count_bins(wp::array_t<float> image, wp::array_t<double> edges, wp::array_t<int> counts) {
    __shared__ int own[BINS];
    __shared__ double steps[BINS + 1];
    const int size = image.shape[0], bins = counts.shape[0];
    for (int i = threadIdx.x; i < bins; i += blockDim.x) own[i] = 0;
    for (int i = threadIdx.x; i <= bins; i += blockDim.x) steps[i] = edges.data[i];
    __syncthreads();
    const double lowest = steps[0], scale = bins / (steps[bins] - lowest);
    int bin = 0, number = 0;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < size; i += gridDim.x * blockDim.x) {
        const double value = image.data[i], guess = (value - lowest) * scale;
        int low = guess > 0.0 ? (guess < bins - 1 ? (int)guess : bins - 1) : 0;
        while (low > 0 && value < steps[low]) --low;
        while (low < bins - 1 && value >= steps[low + 1]) ++low;
        if (low != bin) {
            if (number) atomicAdd(own + bin, number);
            bin = low;
            number = 0;
        }
        ++number;
    }
    if (number) atomicAdd(own + bin, number);
    __syncthreads();
    for (int i = threadIdx.x; i < bins; i += blockDim.x)
        if (own[i]) atomicAdd(counts.data + i, own[i]);
}
