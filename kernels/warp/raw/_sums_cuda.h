#pragma once
// The sum of seen logarithms in steps of 1 / STEPS, their number and both ends: of a thread, and by
// `share` of a block, to one of SLOTS rows. All threads of the block must call `share`.
// needs STEPS, SLOTS
struct Sums {
    enum { NONE = 1 << 30 };  // steps beyond those of any logarithm
    long long total;
    int number, least, most;

    CUDA_CALLABLE Sums() : total(0), number(0), least(NONE), most(-NONE) {}

    CUDA_CALLABLE void add(float value) {
        if (!(value > -500.0f)) return;
        const int fixed = __float2int_rd(value * STEPS + 0.5f);
        total += fixed;
        ++number;
        least = min(least, fixed);
        most = max(most, fixed);
    }

    CUDA_CALLABLE void share(wp::int64* sums) {
        __shared__ unsigned long long all[4];
        // The sum, the number, the largest of 2^32 less, and of 2^32 more.
        const long long none = 4294967296ll;
        long long parts[4] = {total, number, number ? none - least : 0, number ? none + most : 0};
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
