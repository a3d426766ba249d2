// needs WARPS
// Add the columns of `parts` to `sums`. A block has 32 columns; each of its warps adds its share of
// the parts, and the first warp adds the shares.
void add_up(wp::array_t<float> parts, wp::array_t<float> sums) {
    __shared__ float shares[WARPS][32];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, column = blockIdx.x * 32 + lane;
    const int count = parts.shape[0], last = count * (warp + 1) / WARPS;
    float sum = 0.0f;
#pragma unroll 8
    for (int part = count * warp / WARPS; part < last; ++part)
        sum += parts.data[(size_t)part * parts.shape[1] + column];
    shares[warp][lane] = sum;
    __syncthreads();
    if (warp) return;
    for (int other = 1; other < WARPS; ++other) sum += shares[other][lane];
    sums.data[column] += sum;
}
