#pragma once

// The sum of one number per thread over a block of WARPS warps, always in the same order. A
// function may use it only once, because there is shared memory for one sum.
struct BlockSum {
    // Return the sum in all threads; all threads of the block must call it.
    static float of(float x) {
        __shared__ float of_warps[WARPS];
        for (int s = 16; s; s /= 2) x += __shfl_xor_sync(0xffffffffu, x, s);
        if (threadIdx.x % 32 == 0) of_warps[threadIdx.x / 32] = x;
        __syncthreads();
        x = 0.0f;
        for (int warp = 0; warp < WARPS; ++warp) x += of_warps[warp];
        return x;
    }
};
