// A warp takes a row, 32 pixels at a time: forward with the disparity before a gap, then backward
// with the disparity after it.
void fill_rows(wp::array_t<float> disparity, wp::array_t<float> filled,
               wp::array_t<wp::uint8> valid, wp::array_t<int> found) {
    const unsigned ALL = 0xffffffffu;
    const int columns = disparity.shape[1], lane = threadIdx.x % 32;
    const int row = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
    const float* from = disparity.data + (long long)row * columns;
    float* to = filled.data + (long long)row * columns;
    unsigned char* is = valid.data + (long long)row * columns;
    const float infinite = __int_as_float(0x7f800000);
    float nearest = infinite;
    for (int base = 0; base < columns; base += 32) {
        const int x = base + lane;
        const float d = x < columns ? from[x] : infinite;
        const bool here = fabsf(d) < infinite;
        const unsigned before = __ballot_sync(ALL, here) & (ALL >> (31 - lane));
        const float other = __shfl_sync(ALL, d, before ? 31 - __clz(before) : 0);
        const float value = before ? other : nearest;
        if (x < columns) {
            to[x] = value;
            is[x] = here;
        }
        nearest = __shfl_sync(ALL, value, 31);
    }
    if (lane == 0) found.data[row] = nearest < infinite;
    __syncwarp();
    nearest = infinite;
    for (int base = (columns - 1) / 32 * 32; base >= 0; base -= 32) {
        const int x = base + lane;
        const float d = x < columns ? from[x] : infinite, left = x < columns ? to[x] : infinite;
        const unsigned behind = __ballot_sync(ALL, fabsf(d) < infinite) & (ALL << lane);
        const float other = __shfl_sync(ALL, d, behind ? __ffs(behind) - 1 : 0);
        const float value = behind ? other : nearest;
        if (x < columns) to[x] = fminf(left, value);
        nearest = __shfl_sync(ALL, value, 0);
    }
}
