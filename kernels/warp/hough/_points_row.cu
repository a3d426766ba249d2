#pragma once

// A row of a mask, read by a warp.
struct Row {
    static __device__ int index() { return (blockIdx.x * blockDim.x + threadIdx.x) / 32; }

    // Bit k tells whether pixel x + k is set, for k below 16. With `words` the row consists of
    // aligned words of 16 bytes.
    static __device__ unsigned int bits(const unsigned char* pixel, int x, int columns,
                                        bool words) {
        unsigned int bits = 0;
        if (words && x < columns) {
            const uint4 w = *reinterpret_cast<const uint4*>(pixel + x);
            const unsigned int four[4] = {w.x, w.y, w.z, w.w};
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                // One bit of each byte of 255, moved together into four bits.
                const unsigned int ones = __vcmpne4(four[k], 0u) & 0x08040201u;
                bits |= ((ones * 0x01010101u) >> 24 & 15u) << 4 * k;
            }
        } else {
            for (int k = 0; k < 16 && x + k < columns; ++k) bits |= (pixel[x + k] != 0) << k;
        }
        return bits;
    }
};
