// A warp takes a row, 32 pixels at a time: forward with the disparity before a gap, then backward
// with the disparity after it. It reads AHEAD times 32 pixels before it needs the first of them.
void fill_rows(wp::array_t<float> disparity, wp::array_t<float> filled,
               wp::array_t<wp::uint8> valid, wp::array_t<int> found) {
    enum { AHEAD = 8, PART = 32 * AHEAD };
    const unsigned ALL = 0xffffffffu;
    const int columns = disparity.shape[1], lane = threadIdx.x % 32;
    const int row = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
    if (row >= disparity.shape[0]) return;
    const float* from = disparity.data + (long long)row * columns;
    float* to = filled.data + (long long)row * columns;
    unsigned char* is = valid.data + (long long)row * columns;
    const float infinite = __int_as_float(0x7f800000);
    float nearest = infinite;
    for (int part = 0; part < columns; part += PART) {
        float d[AHEAD];
#pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int x = part + 32 * k + lane;
            d[k] = x < columns ? from[x] : infinite;
        }
#pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int x = part + 32 * k + lane;
            const bool here = fabsf(d[k]) < infinite;
            const unsigned before = __ballot_sync(ALL, here) & (ALL >> (31 - lane));
            const float other = __shfl_sync(ALL, d[k], before ? 31 - __clz(before) : 0);
            const float value = before ? other : nearest;
            if (x < columns) {
                to[x] = value;
                is[x] = here;
            }
            nearest = __shfl_sync(ALL, value, 31);
        }
    }
    if (lane == 0) found.data[row] = nearest < infinite;
    __syncwarp();
    nearest = infinite;
    for (int part = (columns - 1) / PART * PART; part >= 0; part -= PART) {
        float d[AHEAD], left[AHEAD];
#pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int x = part + 32 * k + lane;
            d[k] = x < columns ? from[x] : infinite;
            left[k] = x < columns ? to[x] : infinite;
        }
#pragma unroll
        for (int k = AHEAD - 1; k >= 0; --k) {
            const int x = part + 32 * k + lane;
            const unsigned behind = __ballot_sync(ALL, fabsf(d[k]) < infinite) & (ALL << lane);
            const float other = __shfl_sync(ALL, d[k], behind ? __ffs(behind) - 1 : 0);
            const float value = behind ? other : nearest;
            if (x < columns) to[x] = fminf(left[k], value);
            nearest = __shfl_sync(ALL, value, 0);
        }
    }
}

// A warp takes a row. One without disparities is a copy of the nearest one above that has any, or
// else of the nearest one below, or else has none.
void fill_empty_rows(wp::array_t<int> found, wp::array_t<float> filled) {
    const unsigned ALL = 0xffffffffu;
    const int rows = filled.shape[0], columns = filled.shape[1], lane = threadIdx.x % 32;
    const int row = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
    if (row >= rows || found.data[row]) return;  // the whole warp
    int source = -1;
    for (int last = row - 1; last >= 0 && source < 0; last -= 32) {
        const unsigned some = __ballot_sync(ALL, last >= lane && found.data[last - lane]);
        if (some) source = last - (__ffs(some) - 1);
    }
    for (int next = row + 1; next < rows && source < 0; next += 32) {
        const unsigned some = __ballot_sync(ALL, next + lane < rows && found.data[next + lane]);
        if (some) source = next + __ffs(some) - 1;
    }
    const float nothing = __int_as_float(0x7fc00000);
    float* to = filled.data + (long long)row * columns;
    const float* from = filled.data + (long long)(source < 0 ? 0 : source) * columns;
    for (int x = lane; x < columns; x += 32) to[x] = source < 0 ? nothing : from[x];
}
