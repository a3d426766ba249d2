// needs BLOCK
// Return the sum of the counts of the threads before this one in a block. All threads must call it.
int rank_in_block(int count) {
    __shared__ int sums[BLOCK / 32];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    int sum = count;
#pragma unroll
    for (int apart = 1; apart < 32; apart *= 2) {
        const int other = __shfl_up_sync(~0u, sum, apart);
        if (lane >= apart) sum += other;
    }
    if (lane == 31) sums[warp] = sum;
    __syncthreads();
    int before = sum - count;
    for (int w = 0; w < warp; ++w) before += sums[w];
    __syncthreads();
    return before;
}

// Return how many threads of a block have a number that is not 0. All threads must call it.
int count_in_block(int is_there) { return __syncthreads_count(is_there); }
