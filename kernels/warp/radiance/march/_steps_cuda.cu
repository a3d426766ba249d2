float nth_step(int lane, float first, float finest, float cone) {
    // While the spacing and the exponent of t stay the same, each step is rounded as the first one.
    // This is checked: a step from a lane's position must lead to that of the next lane.
    const unsigned all = 0xffffffffu;
    const float gap = first + fmaxf(finest, cone * first) - first;
    float t = first + (float)lane * gap;
    const float next = __shfl_down_sync(all, t, 1);
    if (__all_sync(all, lane == 31 || t + fmaxf(finest, cone * t) == next)) return t;
    t = first;
#pragma unroll
    for (int step = 0; step < 31; ++step) t = step < lane ? t + fmaxf(finest, cone * t) : t;
    return t;
}

void place_all(int capacity, wp::array_t<int> spans, wp::array_t<int> total,
               wp::array_t<int> active) {
    // One block computes the prefix sum: four rays per thread, then the next group of rays.
    const unsigned all = 0xffffffffu;
    __shared__ int sums[8];  // sums of warps
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    const int rays = spans.shape[0];
    int2* span = (int2*)spans.data;
    int placed = 0;
    for (int first = 4 * threadIdx.x; first - 4 * threadIdx.x < rays; first += 4 * blockDim.x) {
        int counts[4], sum = 0;
        for (int i = 0; i < 4; ++i) {
            counts[i] = first + i < rays ? span[first + i].y : 0;
            sum += counts[i];
        }
        int upto = sum;  // sum over the lanes of this warp up to this one
        for (int s = 1; s < 32; s *= 2) {
            const int before = __shfl_up_sync(all, upto, s);
            upto += lane >= s ? before : 0;
        }
        if (lane == 31) sums[warp] = upto;
        __syncthreads();
        int end = placed + upto - sum;
        for (int w = 0; w < warps; ++w) {
            end += w < warp ? sums[w] : 0;
            placed += sums[w];
        }
        placed = min(placed, capacity + 1);  // the sum might not fit 32 bits
        __syncthreads();
        for (int i = 0; i < 4 && first + i < rays; ++i) {
            const int begin = end;
            end += counts[i];
            span[first + i] = end > capacity ? make_int2(capacity, 0) : make_int2(begin, counts[i]);
            if (begin <= capacity && end > capacity) {  // the first without room
                total.data[0] = begin;
                active.data[0] = first + i;
            }
        }
    }
    if (threadIdx.x == 0 && placed <= capacity) total.data[0] = placed;
}
