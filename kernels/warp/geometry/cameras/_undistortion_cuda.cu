#include "_distortion.h"

// needs BYTES, SCALAR, CHANNELS, SEGMENT, STEPS, GROUP, WARPS, FAST, ALL_FAST
// An image seen through a lens. A warp makes STEPS * 32 pixels of a row: its lanes first find the
// places of the nodes, every half segment, then the parabolas between them, in 1/256 pixel: a power
// of two changes no rounding. Bytes of 1 or 3 channels of FAST segments that lie within the image
// are fetched before the first of them is weighed.
void sample_part(wp::array_t<SCALAR> src, wp::array_t<float> numbers, float cval,
                 wp::array_t<SCALAR> dst) {
    enum { PART = STEPS * 32, PARABOLAS = PART / SEGMENT };
    __shared__ __align__(16) float table[WARPS][PARABOLAS][8];
    const int lane = threadIdx.x & 31;
    auto* parabolas = table[threadIdx.x >> 5];
    const int height = src.shape[0], width = src.shape[1], columns = dst.shape[1];
    const unsigned parts = (unsigned)(columns + PART - 1) / PART;
    const int row = (int)(blockIdx.x / parts) * WARPS + (int)(threadIdx.x >> 5);
    const int begin = (int)(blockIdx.x % parts) * PART;
    if (row >= dst.shape[0]) return;  // the whole warp
    const Lens lens(numbers.data, (float)row);
    unsigned inside;  // the segments within the image, bit 2 s
    {
        float u, v, a, b;
        bool within = false;
        const bool met = lens.see((float)(begin + lane * (SEGMENT / 2)), u, v);
        const unsigned there = __ballot_sync(0xffffffffu, met);
        const float u1 = __shfl_down_sync(0xffffffffu, u, 1);
        const float u2 = __shfl_down_sync(0xffffffffu, u, 2);
        const float v1 = __shfl_down_sync(0xffffffffu, v, 1);
        const float v2 = __shfl_down_sync(0xffffffffu, v, 2);
        if (lane < 2 * PARABOLAS && !(lane & 1)) {
            float* to = parabolas[lane >> 1];
            Lens::bend(u, u1, u2, a, b);
            to[0] = 256.0f * u, to[1] = 256.0f * a, to[2] = 256.0f * b;
            within = Lens::within(u, a, u2, (float)width - 1.5f);
            Lens::bend(v, v1, v2, a, b);
            to[4] = 256.0f * v, to[5] = 256.0f * a, to[6] = 256.0f * b;
            to[3] = numbers.data[19] > 0.0f && (there >> lane & 5u) == 5u ? 1.0f : 0.0f;
            // Words that are read may end in the row below the two of a pixel.
            within = within && to[3] > 0.0f && Lens::within(v, a, v2, (float)height - 2.5f);
        }
        inside = __ballot_sync(0xffffffffu, within);
        __syncwarp();
    }
    const float last_x = (float)(width - 1), last_y = (float)(height - 1);
    SCALAR* to = dst.data + ((size_t)row * columns + begin) * CHANNELS;
    const unsigned below = (unsigned)width * CHANNELS;
#if BYTES
    const int outside = (int)(fminf(fmaxf(cval, 0.0f), 255.0f) + 0.5f);
    // Three bytes a pixel are read, and those of four lanes written, as words where these are whole.
    const bool aligned = below % 4 == 0 && (size_t)src.data % 4 == 0;
    const bool reads = CHANNELS == 3 && aligned;
    const bool writes = CHANNELS == 3 && columns % 4 == 0 && (size_t)dst.data % 4 == 0;
    // Four lanes have three words: bytes 0 1 2 0, 1 2 0 1 and 2 0 1 2 of two lanes.
    const int place = lane & 3;
    const unsigned bytes = 0x654210 >> 4 * place;
    unsigned* const own = (unsigned*)(to + (lane >> 2) * 12) + place;
#else
    const float outside = cval;
#endif
    for (int base = 0; base < STEPS && begin + 32 * base < columns; base += GROUP) {
#if BYTES && (CHANNELS == 1 || CHANNELS == 3) && SEGMENT == 32
        // Places in bytes are numbers of 32 bits.
        if (aligned && (CHANNELS == 1 || writes) && base + FAST <= STEPS &&
            (size_t)height * below < (size_t)1 << 31 && begin + 32 * (base + FAST) <= columns &&
            (inside >> 2 * base & ALL_FAST) == ALL_FAST) {
            enum { WORDS = CHANNELS == 1 ? 2 : 3 };
            unsigned word[FAST][2][WORDS], weights[FAST][2], first[FAST];
            const float t = (float)lane;
#pragma unroll
            for (int g = 0; g < FAST; ++g) {
                const float4 p = *(const float4*)parabolas[base + g];
                const float4 q = *(const float4*)(parabolas[base + g] + 4);
                const float u = p.x + t * (p.y + t * p.z), v = q.x + t * (q.y + t * q.z);
                const unsigned ix = (int)(u + 0.5f), iy = (int)(v + 0.5f);
                first[g] = (iy >> 8) * below + (ix >> 8) * CHANNELS;
                // Both weights of the columns, in the lower row and in the upper one. A weight of 2^16
                // is taken as one less, which is rounded to the same byte.
                const unsigned both = (ix & 255) * 65535 + 256;
                weights[g][1] = both * (iy & 255);
                weights[g][0] = both * (256 - (iy & 255)) - (((ix | iy) & 255) == 0);
                // The bytes of both pixels of a row lie in WORDS words, or in one fewer.
                const char* line = (const char*)src.data + (first[g] & ~3u);
#pragma unroll
                for (int i = 0; i < 2; ++i, line += below) {
#pragma unroll
                    for (int n = 0; n < WORDS; ++n)
                        word[g][i][n] = *(const unsigned*)(line + 4 * n);
                }
            }
#pragma unroll
            for (int g = 0; g < FAST; ++g) {
                const unsigned turn = 8 * first[g];
                unsigned made[CHANNELS];
#pragma unroll
                for (int c = 0; c < CHANNELS; ++c) made[c] = 32768;
#pragma unroll
                for (int i = 0; i < 2; ++i) {
                    const unsigned* w = word[g][i];
                    const unsigned one = __funnelshift_r(w[0], w[1], turn);
#if CHANNELS == 1
                    made[0] = __dp2a_lo(weights[g][i], one, made[0]);
#else
                    const unsigned two = __funnelshift_r(w[1], w[2], turn);
                    const unsigned both = __byte_perm(one, two, 0x4130);
                    made[0] = __dp2a_lo(weights[g][i], both, made[0]);
                    made[1] = __dp2a_hi(weights[g][i], both, made[1]);
                    made[2] = __dp2a_lo(weights[g][i], __byte_perm(one, two, 0x0052), made[2]);
#endif
                }
#if CHANNELS == 1
                to[32 * (base + g) + lane] = (SCALAR)(made[0] >> 16);
#else
                const unsigned all =
                    __byte_perm(__byte_perm(made[0], made[1], 0x0062), made[2], 0x7610);
                const unsigned next = __shfl_down_sync(0xffffffffu, all, 1);
                if (place < 3) own[24 * (base + g)] = __byte_perm(all, next, bytes);
#endif
            }
            base += FAST - GROUP;
            continue;
        }
#endif
        bool met[GROUP];
        SCALAR a[GROUP][2 * CHANNELS], b[GROUP][2 * CHANNELS];
#if BYTES
        int along[GROUP], down[GROUP];
#else
        float along[GROUP], down[GROUP];
#endif
#pragma unroll
        for (int g = 0; g < GROUP; ++g) {
            const int k = 32 * (base + g) + lane;
            const float t = (float)(k % SEGMENT);
            const float4 p = *(const float4*)parabolas[k / SEGMENT];
            const float4 q = *(const float4*)(parabolas[k / SEGMENT] + 4);
            float u = (p.x + t * (p.y + t * p.z)) * (1.0f / 256.0f);
            float v = (q.x + t * (q.y + t * q.z)) * (1.0f / 256.0f);
            bool in = true;
            if (p.w == 0.0f) in = lens.see((float)(begin + k), u, v);
            in = in && u >= 0.0f && v >= 0.0f && u <= last_x && v <= last_y;
            u = in ? u : 0.0f, v = in ? v : 0.0f;
            met[g] = in;
#if BYTES
            const int ix = (int)(u * 256.0f + 0.5f), iy = (int)(v * 256.0f + 0.5f);
            const int x0 = min(ix >> 8, width - 2), y0 = min(iy >> 8, height - 2);
            along[g] = ix - (x0 << 8), down[g] = iy - (y0 << 8);
#else
            const int x0 = min((int)u, width - 2), y0 = min((int)v, height - 2);
            along[g] = u - (float)x0, down[g] = v - (float)y0;
#endif
            const size_t first = ((size_t)y0 * width + x0) * CHANNELS;
#if BYTES && CHANNELS == 3
            if (reads) {
                // Six bytes lie in two words, or in three if they begin with the last byte of one.
                const unsigned* word = (const unsigned*)src.data + (first >> 2);
                const int turn = (int)(first & 3) * 8, third = turn == 24 ? 2 : 1;
                const unsigned* under = word + (below >> 2);
                const unsigned w0 = word[0], w1 = word[1], w2 = word[third];
                const unsigned z0 = under[0], z1 = under[1], z2 = under[third];
                const unsigned one = __funnelshift_r(w0, w1, turn);
                const unsigned two = __funnelshift_r(w1, w2, turn);
                const unsigned three = __funnelshift_r(z0, z1, turn);
                const unsigned four = __funnelshift_r(z1, z2, turn);
#pragma unroll
                for (int c = 0; c < 4; ++c) a[g][c] = one >> 8 * c, b[g][c] = three >> 8 * c;
#pragma unroll
                for (int c = 0; c < 2; ++c) a[g][4 + c] = two >> 8 * c, b[g][4 + c] = four >> 8 * c;
                continue;
            }
#endif
#pragma unroll
            for (int c = 0; c < 2 * CHANNELS; ++c)
                a[g][c] = src.data[first + c], b[g][c] = src.data[first + below + c];
        }
#pragma unroll
        for (int g = 0; g < GROUP; ++g) {
            const int k = 32 * (base + g) + lane;
#if BYTES
            unsigned made[CHANNELS], all = 0;
#pragma unroll
            for (int c = 0; c < CHANNELS; ++c) {
                const int top = a[g][c] * (256 - along[g]) + a[g][c + CHANNELS] * along[g];
                const int low = b[g][c] * (256 - along[g]) + b[g][c + CHANNELS] * along[g];
                made[c] = (unsigned)(top * (256 - down[g]) + low * down[g] + 32768) >> 16;
                made[c] = met[g] ? made[c] : (unsigned)outside;
                all |= made[c] << 8 * c;
            }
            if (writes) {
                const unsigned next = __shfl_down_sync(0xffffffffu, all, 1);
                if (begin + k < columns && place < 3)
                    own[24 * (base + g)] = __byte_perm(all, next, bytes);
            } else if (begin + k < columns) {
                for (int c = 0; c < CHANNELS; ++c) to[k * CHANNELS + c] = (SCALAR)made[c];
            }
#else
            if (begin + k < columns)
                for (int c = 0; c < CHANNELS; ++c) {
                    const float top = a[g][c] + along[g] * (a[g][c + CHANNELS] - a[g][c]);
                    const float low = b[g][c] + along[g] * (b[g][c + CHANNELS] - b[g][c]);
                    to[k * CHANNELS + c] = met[g] ? top + down[g] * (low - top) : outside;
                }
#endif
        }
    }
}
