#pragma once

// The outcome of a ray so far, and its samples in planes of 8 bits.
struct Walked {
    float red, green, blue, weight, far, through;

    // Composite a sample, whose numbers are in units of `unit`, unless the ray has ended.
    void over(const float* sample, float unit, float away, float stop) {
        const float scale = through > stop ? unit * through : 0.0f, part = scale * sample[3];
        red += scale * sample[0];
        green += scale * sample[1];
        blue += scale * sample[2];
        weight += part;
        far += part * away;
        through -= part;
    }

    // Interpolate between four texels, at x / 256 and y / 256 from the first one. The sample is in
    // units of 1 / (255 * 256): integers, which are summed as the lowest bits of 2^23 in float32.
    static void between(const unsigned* texels, unsigned x, unsigned y, float* sample) {
        const unsigned both = x * y + 128u >> 8;
        // Two weights in 16 bits each: of the left and of the right texels.
        const unsigned below = y + both * 65535u, above = 256u + x * 65535u - below;
        unsigned sums[4] = {0x4B000000u, 0x4B000000u, 0x4B000000u, 0x4B000000u};
#pragma unroll
        for (int row = 0; row < 2; ++row) {
            const unsigned *pair = texels + 2 * row, weights = row ? below : above;
            // Bytes of the two by turns: a product takes those of one channel, with both weights.
            const unsigned low = __byte_perm(pair[0], pair[1], 0x5140);
            const unsigned high = __byte_perm(pair[0], pair[1], 0x7362);
            asm("dp2a.lo.u32.u32 %0, %1, %2, %0;" : "+r"(sums[0]) : "r"(weights), "r"(low));
            asm("dp2a.hi.u32.u32 %0, %1, %2, %0;" : "+r"(sums[1]) : "r"(weights), "r"(low));
            asm("dp2a.lo.u32.u32 %0, %1, %2, %0;" : "+r"(sums[2]) : "r"(weights), "r"(high));
            asm("dp2a.hi.u32.u32 %0, %1, %2, %0;" : "+r"(sums[3]) : "r"(weights), "r"(high));
        }
#pragma unroll
        for (int n = 0; n < 4; ++n) sample[n] = __uint_as_float(sums[n]) - 8388608.0f;
    }
};
