#include "../_block_sum.cu"

// needs WARPS
void sum_cells(wp::array_t<float> density, wp::array_t<float> parts) {
    const float4* four = (const float4*)density.data;
    const int fours = density.shape[0] / 4;
    float x = 0.0f;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < fours; i += gridDim.x * blockDim.x) {
        const float4 v = four[i];
        x += (v.x + v.y) + (v.z + v.w);
    }
    x = BlockSum::of(x);
    if (threadIdx.x == 0) parts.data[blockIdx.x] = x;
}

// needs WARPS
void mark_cells(wp::array_t<float> density, wp::array_t<float> parts, float least,
                wp::array_t<float> limit, wp::array_t<unsigned> bits) {
    const float4* four = (const float4*)density.data;
    const int fours = density.shape[0] / 4;
    float x = 0.0f;
    for (int i = threadIdx.x; i < parts.shape[0]; i += blockDim.x) x += parts.data[i];
    const float bound = fminf(least, BlockSum::of(x) / (float)density.shape[0]);
    if (blockIdx.x == 0 && threadIdx.x == 0) limit.data[0] = bound;
    const int nibble = threadIdx.x % 8;  // eight lanes write a word
    for (int first = blockIdx.x * blockDim.x; first < fours; first += gridDim.x * blockDim.x) {
        const int i = first + threadIdx.x;
        const float4 v = four[min(i, fours - 1)];
        const unsigned low = (v.x > bound) | (v.y > bound) << 1;
        unsigned word = (low | (v.z > bound) << 2 | (v.w > bound) << 3) << 4 * nibble;
        for (int s = 1; s < 8; s *= 2) word |= __shfl_xor_sync(0xffffffffu, word, s);
        if (nibble == 0 && i < fours) bits.data[i / 8] = word;
    }
}
