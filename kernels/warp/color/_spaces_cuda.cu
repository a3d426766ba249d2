// Linear colours times a matrix, as bytes of sRGB, four pixels a thread: three vectors of four
// values, and three words of four bytes. The table of steps lies in shared memory.
// needs DARKEST, FIRST, STEPS
void encode_four(wp::array_t<float> colours, wp::array_t<float> numbers, wp::array_t<int> steps,
                 wp::array_t<wp::uint8> out) {
    __shared__ int table[STEPS];
    for (int i = threadIdx.x; i < STEPS; i += blockDim.x) table[i] = steps.data[i];
    __syncthreads();
    float m[9];
    for (int k = 0; k < 9; ++k) m[k] = numbers.data[k];
    const auto code = [&](float v) {
        const int bits = __float_as_int(v > DARKEST ? fminf(v, 1.0f) : DARKEST);
        return (unsigned)(table[(bits >> 16) - FIRST] + (bits & 0xffff)) >> 16;
    };
    const int groups = out.shape[0] / 4;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < groups; i += gridDim.x * blockDim.x) {
        const float4* from = (const float4*)colours.data + 3 * (size_t)i;
        const float4 a = from[0], b = from[1], c = from[2];
        const float v[12] = {a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y, c.z, c.w};
        unsigned words[3] = {0, 0, 0};
#pragma unroll
        for (int n = 0; n < 12; ++n) {
            const float *p = v + n / 3 * 3, *r = m + n % 3 * 3;
            words[n / 4] |= code((r[0] * p[0] + r[1] * p[1]) + r[2] * p[2]) << (n % 4 * 8);
        }
        unsigned* to = (unsigned*)out.data + 3 * (size_t)i;
        for (int k = 0; k < 3; ++k) to[k] = words[k];
    }
}
