#include "_distortion.h"

// needs BYTES, SCALAR, CHANNELS, SEGMENT, STEPS, WARPS
// An image seen through a lens. A warp makes STEPS * 32 pixels of a row: its lanes first find the
// places of the nodes, every half segment, then the parabolas between them.
void sample_part(wp::array_t<SCALAR> src, wp::array_t<float> numbers, float cval,
                 wp::array_t<SCALAR> dst) {
    enum { PART = STEPS * 32, PARABOLAS = PART / SEGMENT };
    __shared__ __align__(16) float table[WARPS][PARABOLAS][8];
    const int lane = threadIdx.x & 31;
    auto* parabolas = table[threadIdx.x >> 5];
    const unsigned item = (unsigned)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5);
    const int height = src.shape[0], width = src.shape[1], columns = dst.shape[1];
    const unsigned parts = (unsigned)(columns + PART - 1) / PART;
    const int row = (int)(item / parts), begin = (int)(item % parts) * PART;
    if (row >= dst.shape[0]) return;  // the whole warp
    const Lens lens(numbers.data, (float)row);
    {
        float u, v, a, b;
        const bool met = lens.see((float)(begin + lane * (SEGMENT / 2)), u, v);
        const unsigned there = __ballot_sync(0xffffffffu, met);
        const float u1 = __shfl_down_sync(0xffffffffu, u, 1);
        const float u2 = __shfl_down_sync(0xffffffffu, u, 2);
        const float v1 = __shfl_down_sync(0xffffffffu, v, 1);
        const float v2 = __shfl_down_sync(0xffffffffu, v, 2);
        if (lane < 2 * PARABOLAS && !(lane & 1)) {
            float* to = parabolas[lane >> 1];
            Lens::bend(u, u1, u2, a, b);
            to[0] = u, to[1] = a, to[2] = b;
            Lens::bend(v, v1, v2, a, b);
            to[4] = v, to[5] = a, to[6] = b;
            to[3] = numbers.data[19] > 0.0f && (there >> lane & 5u) == 5u ? 1.0f : 0.0f;
        }
        __syncwarp();
    }
    const float last_x = (float)(width - 1), last_y = (float)(height - 1);
    const unsigned below = (unsigned)width * CHANNELS;
    SCALAR* to = dst.data + ((size_t)row * columns + begin) * CHANNELS;
#if BYTES
    const int outside = (int)(fminf(fmaxf(cval, 0.0f), 255.0f) + 0.5f);
    // Four lanes put the bytes of their pixels together, where rows begin at whole words.
    const bool words = CHANNELS == 3 && columns % 4 == 0 && (size_t)dst.data % 4 == 0;
#else
    const float outside = cval;
#endif
    const float t = (float)(lane % SEGMENT);
#pragma unroll
    for (int step = 0; step < STEPS; ++step) {
        const int k = 32 * step + lane;
        if (begin + 32 * step >= columns) break;  // the whole warp
        const float4 p = *(const float4*)parabolas[k / SEGMENT];
        const float4 q = *(const float4*)(parabolas[k / SEGMENT] + 4);
        float u = p.x + t * (p.y + t * p.z), v = q.x + t * (q.y + t * q.z);
        bool met = true;
        if (p.w == 0.0f) met = lens.see((float)(begin + k), u, v);
        met = met && u >= 0.0f && v >= 0.0f && u <= last_x && v <= last_y;
        u = met ? u : 0.0f, v = met ? v : 0.0f;
#if BYTES
        const int ix = (int)(u * 256.0f + 0.5f), iy = (int)(v * 256.0f + 0.5f);
        const int x0 = min(ix >> 8, width - 2), y0 = min(iy >> 8, height - 2);
        const int along = ix - (x0 << 8), down = iy - (y0 << 8);
#else
        const int x0 = min((int)u, width - 2), y0 = min((int)v, height - 2);
        const float along = u - (float)x0, down = v - (float)y0;
#endif
        const SCALAR* a = src.data + ((size_t)y0 * width + x0) * CHANNELS;
        const SCALAR* b = a + below;
#if BYTES
        unsigned made[CHANNELS], all = 0;
#pragma unroll
        for (int c = 0; c < CHANNELS; ++c) {
            const int top = a[c] * (256 - along) + a[c + CHANNELS] * along;
            const int low = b[c] * (256 - along) + b[c + CHANNELS] * along;
            made[c] = (unsigned)(top * (256 - down) + low * down + 32768) >> 16;
            made[c] = met ? made[c] : (unsigned)outside;
            all |= made[c] << 8 * c;
        }
        if (words) {
            const unsigned next = __shfl_down_sync(0xffffffffu, all, 1);
            const int turn = lane & 3;
            if (begin + k < columns && turn < 3)
                *(unsigned*)(to + (k >> 2) * 12 + 4 * turn) =
                    all >> 8 * turn | next << (24 - 8 * turn);
        } else if (begin + k < columns) {
            for (int c = 0; c < CHANNELS; ++c) to[k * CHANNELS + c] = (SCALAR)made[c];
        }
#else
        if (begin + k < columns)
            for (int c = 0; c < CHANNELS; ++c) {
                const float top = a[c] + along * (a[c + CHANNELS] - a[c]);
                const float low = b[c] + along * (b[c + CHANNELS] - b[c]);
                to[k * CHANNELS + c] = met ? top + down * (low - top) : outside;
            }
#endif
    }
}
