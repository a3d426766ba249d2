#include "../_block_sum.cu"

// needs WARPS
void add_block(wp::array_t<float> gradients, wp::array_t<float> parts) {
    const int count = gradients.shape[0], quads = count / 4, part = blockIdx.x;
    float sum = 0.0f;
    for (int i = part * (32 * WARPS) + threadIdx.x; i < quads; i += parts.shape[0] * (32 * WARPS)) {
        const float4 g = ((const float4*)gradients.data)[i];
        sum += (g.x * g.x + g.y * g.y) + (g.z * g.z + g.w * g.w);
    }
    const int left = 4 * quads + threadIdx.x;
    if (part == 0 && left < count) sum += gradients.data[left] * gradients.data[left];
    sum = BlockSum::of(sum);
    if (threadIdx.x == 0) parts.data[part] += sum;
}

// needs WARPS
void shrink(float scale, float most, wp::array_t<float> parts, wp::array_t<float> factor) {
    float sum = 0.0f;
    for (int part = threadIdx.x; part < parts.shape[0]; part += 32 * WARPS) {
        sum += parts.data[part];
        parts.data[part] = 0.0f;
    }
    const float norm = sqrtf(BlockSum::of(sum)) * scale;
    if (threadIdx.x == 0) factor.data[0] = norm > most ? scale * (most / norm) : scale;
}
