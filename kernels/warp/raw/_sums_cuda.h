#pragma once
// The sum of seen logarithms in steps of 1 / STEPS, their number and both ends: of a thread, and by
// `share` of a block, to one of SLOTS rows. All threads of the block must call `share`.
// needs STEPS, SLOTS
struct Sums {
    long long parts[4];  // the sum, the number, the largest of 2^32 less, and of 2^32 more

    CUDA_CALLABLE Sums() { parts[0] = parts[1] = parts[2] = parts[3] = 0; }

    CUDA_CALLABLE void add(float value) {
        if (!(value > -500.0f)) return;
        const long long fixed = (long long)floorf(value * STEPS + 0.5f);
        const long long low = 4294967296ll - fixed, high = 4294967296ll + fixed;
        parts[0] += fixed;
        parts[1] += 1;
        parts[2] = parts[2] > low ? parts[2] : low;
        parts[3] = parts[3] > high ? parts[3] : high;
    }

    CUDA_CALLABLE void share(wp::int64* sums) {
        __shared__ unsigned long long all[4];
        if (threadIdx.x < 4) all[threadIdx.x] = 0;
        __syncthreads();
        for (int step = 16; step; step /= 2)
            for (int k = 0; k < 4; ++k) {
                const long long other = __shfl_xor_sync(0xffffffffu, parts[k], step);
                if (k < 2)
                    parts[k] += other;
                else
                    parts[k] = parts[k] > other ? parts[k] : other;
            }
        if (threadIdx.x % 32 == 0)
            for (int k = 0; k < 4; ++k) {
                if (k < 2)
                    atomicAdd(all + k, (unsigned long long)parts[k]);
                else
                    atomicMax(all + k, (unsigned long long)parts[k]);
            }
        __syncthreads();
        unsigned long long* to = (unsigned long long*)sums + blockIdx.x % SLOTS * 4;
        if (threadIdx.x < 2) atomicAdd(to + threadIdx.x, all[threadIdx.x]);
        if (threadIdx.x >= 2 && threadIdx.x < 4) atomicMax(to + threadIdx.x, all[threadIdx.x]);
    }
};
