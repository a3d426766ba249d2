#include "_total_cuda.h"

// needs COST_TYPE, COST_BYTES, BLOCK
void collect(wp::array_t<COST_TYPE> costs, wp::array_t<PATH_TYPE> lines, int top, bool adds,
             bool aligned, wp::array_t<wp::uint16> sums) {
    const unsigned i = blockIdx.x * BLOCK + threadIdx.x;
    const int padded = costs.shape[2], depth = sums.shape[2], d = i % (padded / 16) * 16;
    const long long pixel = i / (padded / 16), pixels = (long long)sums.shape[0] * sums.shape[1];
    if (pixel >= pixels) return;
    const long long at = pixel * padded + d, from = at + (long long)top * costs.shape[1] * padded;
    unsigned total[8];
    Total::of_chunk(lines.data, pixels * padded, at, total);
// Each path has stored L - C.
#pragma unroll
    for (int j = 0; j < COST_BYTES; ++j) {
        const uint4 c = reinterpret_cast<const uint4*>(costs.data + from)[j];
        const unsigned word[4] = {c.x, c.y, c.z, c.w};
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            if (COST_BYTES == 1) {
                total[2 * k] += __byte_perm(word[k], 0, 0x4140) * COUNT;
                total[2 * k + 1] += __byte_perm(word[k], 0, 0x4342) * COUNT;
            } else {
                total[4 * j + k] += word[k] * COUNT;
            }
        }
    }
    unsigned short* to = sums.data + pixel * depth + d;
    if (aligned) {
        uint4* eight = reinterpret_cast<uint4*>(to);
#pragma unroll
        for (int j = 0; j < 2; ++j) {
            uint4 s = make_uint4(0, 0, 0, 0);
            if (d + 8 * j < depth) {
                if (adds) s = eight[j];
                eight[j] = make_uint4(s.x + total[4 * j], s.y + total[4 * j + 1],
                                      s.z + total[4 * j + 2], s.w + total[4 * j + 3]);
            }
        }
    } else {
#pragma unroll
        for (int j = 0; j < 16; ++j)
            if (d + j < depth)
                to[j] = (adds ? to[j] : 0) + (unsigned short)(total[j / 2] >> 16 * (j % 2));
    }
}
