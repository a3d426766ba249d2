// Least squares of photometric stereo. The values of a pixel are needed twice, for the solution and
// for its residual; between the two they stay in registers, so that each image is read once. A
// thread has PIXELS pixels. Empty statements of assembly keep the compiler from computing addresses
// or products ahead, for which no register is left.
// needs COUNT, PIXELS
void solve_kept(wp::array_t<float> images, wp::array_t<float> inverse, wp::array_t<float> lights,
                wp::array_t<wp::uint8> mask, wp::array_t<float> normals, wp::array_t<float> albedo,
                wp::array_t<float> residual) {
    __shared__ float4 rows[COUNT], lamps[COUNT];
    const size_t plane = (size_t)images.shape[1] * images.shape[2];
    for (int k = threadIdx.x; k < COUNT; k += blockDim.x) {
        rows[k].x = inverse.data[k];
        rows[k].y = inverse.data[COUNT + k];
        rows[k].z = inverse.data[2 * COUNT + k];
        lamps[k] = ((const float4*)lights.data)[k];
    }
    __syncthreads();
    size_t here[PIXELS];
    float kept[PIXELS][COUNT], a[PIXELS], b[PIXELS], c[PIXELS], total[PIXELS];
#pragma unroll
    for (int p = 0; p < PIXELS; ++p) {
        here[p] = ((size_t)blockIdx.x * PIXELS + p) * blockDim.x + threadIdx.x;
        a[p] = b[p] = c[p] = total[p] = 0.0f;
        // Values beyond the last pixel are not used.
        const float* from = images.data + (here[p] < plane ? here[p] : 0);
#pragma unroll
        for (int k = 0; k < COUNT; ++k) {
            kept[p][k] = __ldcs(from);
            from += plane;
            asm volatile("" : "+l"(from));
        }
    }
#pragma unroll
    for (int k = 0; k < COUNT; ++k) {
        const float4 row = rows[k];
#pragma unroll
        for (int p = 0; p < PIXELS; ++p) {
            a[p] += row.x * kept[p][k];
            b[p] += row.y * kept[p][k];
            c[p] += row.z * kept[p][k];
            asm volatile("" : "+f"(a[p]), "+f"(b[p]), "+f"(c[p]));
        }
    }
#pragma unroll
    for (int k = 0; k < COUNT; ++k) {
        const float4 light = lamps[k];
#pragma unroll
        for (int p = 0; p < PIXELS; ++p) {
            const float e = light.x * a[p] + light.y * b[p] + light.z * c[p];
            const float off = kept[p][k] - (e > 0.0f ? e : 0.0f);
            total[p] += off * off;
            asm volatile("" : "+f"(total[p]));
        }
    }
#pragma unroll
    for (int p = 0; p < PIXELS; ++p) {
        if (here[p] >= plane) continue;
        const float length = sqrtf(a[p] * a[p] + b[p] * b[p] + c[p] * c[p]);
        const bool inside = mask.shape[0] == 0 || mask.data[here[p]];
        const bool found = inside && length > 0.0f && length < __int_as_float(0x7f800000);
        const float none = __int_as_float(0x7fc00000);
        float* normal = normals.data + 3 * here[p];
        normal[0] = found ? a[p] / length : none;
        normal[1] = found ? b[p] / length : none;
        normal[2] = found ? c[p] / length : none;
        albedo.data[here[p]] = found ? length : 0.0f;
        residual.data[here[p]] = found ? sqrtf(total[p] / (float)COUNT) : 0.0f;
    }
}
