// Least squares of photometric stereo. The values of a pixel are needed twice, for the solution and
// for its residual; between the two they stay in shared memory, where each thread has a column.
// needs KEPT
void solve_kept(wp::array_t<float> images, wp::array_t<float> inverse, wp::array_t<float> lights,
                wp::array_t<wp::uint8> mask, wp::array_t<float> normals, wp::array_t<float> albedo,
                wp::array_t<float> residual) {
    __shared__ float kept[KEPT];
    const int count = images.shape[0];
    const size_t plane = (size_t)images.shape[1] * images.shape[2];
    const size_t here = (size_t)blockIdx.x * blockDim.x + threadIdx.x;
    if (here >= plane) return;
    float* own = kept + threadIdx.x;
    const float* from = images.data + here;
    float a = 0.0f, b = 0.0f, c = 0.0f, total = 0.0f;
#pragma unroll 16
    for (int k = 0; k < count; ++k) {
        const float value = __ldcs(from + k * plane);
        own[k * blockDim.x] = value;
        a += inverse.data[k] * value;
        b += inverse.data[count + k] * value;
        c += inverse.data[2 * count + k] * value;
    }
#pragma unroll 8
    for (int k = 0; k < count; ++k) {
        const float4 light = ((const float4*)lights.data)[k];
        const float e = light.x * a + light.y * b + light.z * c;
        const float off = own[k * blockDim.x] - (e > 0.0f ? e : 0.0f);
        total += off * off;
    }
    const float length = sqrtf(a * a + b * b + c * c);
    const bool inside = mask.shape[0] == 0 || mask.data[here];
    const bool found = inside && length > 0.0f && length < __int_as_float(0x7f800000);
    const float none = __int_as_float(0x7fc00000);
    float* normal = normals.data + 3 * here;
    normal[0] = found ? a / length : none;
    normal[1] = found ? b / length : none;
    normal[2] = found ? c / length : none;
    albedo.data[here] = found ? length : 0.0f;
    residual.data[here] = found ? sqrtf(total / (float)count) : 0.0f;
}
