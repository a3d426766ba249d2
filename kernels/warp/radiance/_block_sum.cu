#pragma once

// The sum of a number of each thread of a block of WARPS warps, always in the same order. A
// function uses it once: there is shared memory for one sum.
struct BlockSum {
    // Return the sum in all threads; all of the block call it.
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
