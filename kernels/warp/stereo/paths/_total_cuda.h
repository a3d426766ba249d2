// Sums over the paths for 16 disparities, beginning at `at` in each volume. A number holds two
// sums of 16 bits: pairs (0, 1), (2, 3) and so on. No carry occurs, because sums are below 65536.
// needs PATH_TYPE, PATH_BYTES, COUNT
struct Total {
    static void of_chunk(const PATH_TYPE* lines, long long volume, long long at, unsigned* total) {
        unsigned even[4], odd[4];  // pairs (0, 2), ...; (1, 3), ...
        uint4 chunk[COUNT][PATH_BYTES];
#pragma unroll
        for (int r = 0; r < COUNT; ++r) {
#pragma unroll
            for (int j = 0; j < PATH_BYTES; ++j)
                chunk[r][j] = __ldcs(reinterpret_cast<const uint4*>(lines + r * volume + at) + j);
        }
#pragma unroll
        for (int k = 0; k < 8; ++k) total[k] = even[k / 2] = odd[k / 2] = 0;
#pragma unroll
        for (int r = 0; r < COUNT; ++r) {
#pragma unroll
            for (int j = 0; j < PATH_BYTES; ++j) {
                const unsigned word[4] = {chunk[r][j].x, chunk[r][j].y, chunk[r][j].z,
                                          chunk[r][j].w};
#pragma unroll
                for (int k = 0; k < 4; ++k) {
                    if (PATH_BYTES == 1) {
                        even[k] += word[k] & 0xff00ffu;
                        odd[k] += word[k] >> 8 & 0xff00ffu;
                    } else {
                        total[4 * j + k] += word[k];
                    }
                }
            }
        }
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            total[2 * k] += __byte_perm(even[k], odd[k], 0x5410);
            total[2 * k + 1] += __byte_perm(even[k], odd[k], 0x7632);
        }
    }
};
