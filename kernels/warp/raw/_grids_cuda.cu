// A bilateral grid on CUDA: a thread reads the cells around four pixels of a row.
#include "_sums_cuda.h"

// needs STEPS, SLOTS
void read_four(wp::array_t<float> logs, wp::array_t<float> cells, float lowest, float space,
               float depth, wp::array_t<float> out, wp::array_t<wp::int64> sums) {
    const int height = logs.shape[0], width = logs.shape[1], parts = (width + 3) / 4;
    const int down = cells.shape[1] * cells.shape[2];
    const bool aligned = width % 4 == 0 && (((size_t)logs.data | (size_t)out.data) & 15) == 0;
    const auto between = [](float2 a, float2 b, float f) {
        return make_float2(a.x + f * (b.x - a.x), a.y + f * (b.y - a.y));
    };
    Sums own;
    for (int i = blockIdx.x * blockDim.x + threadIdx.x; i < height * parts;
         i += gridDim.x * blockDim.x) {
        const int row = i / parts, begin = i % parts * 4;
        const size_t start = (size_t)row * width + begin;
        const float y = (float)row * space + 2.0f;
        const float fy = y - (float)(int)y;
        float v[4] = {lowest, lowest, lowest, lowest};
        if (aligned) {
            const float4 four = *(const float4*)(logs.data + start);
            v[0] = four.x;
            v[1] = four.y;
            v[2] = four.z;
            v[3] = four.w;
        } else {
            for (int k = 0; k < 4; ++k)
                if (begin + k < width) v[k] = logs.data[start + k];
        }
        for (int k = 0; k < 4; ++k) {
            // A pixel beyond the row reads the cells of its end, and is not written.
            const int column = begin + k < width ? begin + k : width - 1;
            const float x = (float)column * space + 2.0f, z = (v[k] - lowest) * depth + 2.0f;
            const float fx = x - (float)(int)x, fz = z - (float)(int)z;
            const float2* at = (const float2*)cells.data +
                               ((int)y * cells.shape[1] + (int)x) * cells.shape[2] + (int)z;
            float2 near[2];
            for (int n = 0; n < 2; ++n) {
                const float2* p = at + n * down;
                near[n] = between(between(p[0], p[1], fz),
                                  between(p[cells.shape[2]], p[cells.shape[2] + 1], fz), fx);
            }
            const float2 found = between(near[0], near[1], fy);
            v[k] = lowest + found.x / ((found.y > 1.0e-12f ? found.y : 1.0e-12f) * STEPS);
            if (begin + k < width) own.add(v[k]);
        }
        if (aligned)
            *(float4*)(out.data + start) = make_float4(v[0], v[1], v[2], v[3]);
        else
            for (int k = 0; k < 4; ++k)
                if (begin + k < width) out.data[start + k] = v[k];
    }
    own.share(sums.data);
}
