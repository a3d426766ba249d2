#include "../_bytes_cpu.h"

// Nearest descriptors on the CPU; matching.py has the rule. Those of the other image are packed so
// that a vector holds 4 bytes of each of 16 descriptors; 8 rows are compared with them at a time.

// needs LANES, LARGEST
// Lay 16 descriptors side by side: 4 bytes (8 of binary ones) of the first, of the second, ...
void pack_group(int group, wp::array_t<wp::uint8> descriptors, wp::array_t<int> groups, int binary,
                wp::array_t<wp::uint8> packed, wp::array_t<int> norms) {
    const int size = descriptors.shape[1];
    const int first = groups.data[2 * group], count = groups.data[2 * group + 1];
    wp::uint8* out = packed.data + (size_t)group * size * LANES;
    for (int j = 0; j < LANES; ++j) {
        const wp::uint8* from = descriptors.data + (size_t)(first + (j < count ? j : 0)) * size;
        int norm = 0;
        for (int k = 0; k < size; ++k) {
            // With 128 taken away they are signed, which is what the dot product of bytes takes.
            const int at = binary ? (k / 8 * LANES + j) * 8 + k % 8 : Bytes::place(j, k);
            out[at] = binary ? from[k] : from[k] ^ 128;
            norm += from[k] * from[k];
        }
        norms.data[group * LANES + j] = j < count ? (binary ? 0 : norm) : LARGEST;
    }
}

// needs LANES, LARGEST
// Nearest and second nearest descriptor of an image, for the rows of a block.
void match_block(int block, wp::array_t<wp::uint8> descriptors, wp::array_t<int> blocks,
                 wp::array_t<int> group_of, int binary, wp::array_t<wp::uint8> packed,
                 wp::array_t<int> norms, wp::array_t<int> best, wp::array_t<int> second,
                 wp::array_t<int> index) {
    typedef Bytes::Lanes lanes;
    const int size = descriptors.shape[1];
    const int* b = blocks.data + 5 * (size_t)block;
    const int from = group_of.data[block], groups = (b[3] - b[2] + LANES - 1) / LANES;
    lanes step;
    for (int j = 0; j < LANES; ++j) step[j] = j;
    for (int row = b[0]; row < b[1]; row += ROWS) {
        const wp::uint8* rows[ROWS];
        int base[ROWS];
        lanes top[ROWS], next[ROWS], where[ROWS];
        for (int r = 0; r < ROWS; ++r) {
            const int at = row + r < b[1] ? row + r : b[1] - 1;
            rows[r] = descriptors.data + (size_t)at * size;
            int norm = 0, sum = 0;
            for (int k = 0; k < size; ++k) {
                norm += rows[r][k] * rows[r][k];
                sum += rows[r][k];
            }
            base[r] = binary ? 0 : norm - 256 * sum;  // |a|^2 - 2 a (b' + 128) = ... - 2 a b'
            top[r] = next[r] = (lanes){} + 0x7fffffff;
            where[r] = (lanes){};
        }
        for (int g = 0; g < groups; ++g) {
            const wp::uint8* p = packed.data + (size_t)(from + g) * size * LANES;
            const lanes norm = *(const lanes*)(norms.data + (size_t)(from + g) * LANES);
            lanes dots[ROWS];
            if (binary) {
                for (int r = 0; r < ROWS; ++r) {
                    int total[LANES] = {0};
                    for (int k = 0; k < size; k += 8) {
                        unsigned long long own, other[LANES];
                        __builtin_memcpy(&own, rows[r] + k, 8);
                        __builtin_memcpy(other, p + (size_t)k * LANES, 8 * LANES);
                        for (int j = 0; j < LANES; ++j)
                            total[j] += __builtin_popcountll(own ^ other[j]);
                    }
                    __builtin_memcpy(&dots[r], total, sizeof total);
                }
            } else {
                Bytes::multiply(rows, p, size, dots);
            }
            const lanes here = step + g * LANES;
#pragma unroll
            for (int r = 0; r < ROWS; ++r) {
                const lanes d = binary ? dots[r] + norm : norm + base[r] - 2 * dots[r];
                const lanes nearer = d < top[r];
                const lanes worse = nearer ? top[r] : d;
                next[r] = worse < next[r] ? worse : next[r];
                where[r] = nearer ? here : where[r];
                top[r] = nearer ? d : top[r];
            }
        }
        for (int r = 0; r < ROWS && row + r < b[1]; ++r) {
            int d = 0x7fffffff, at = 0, lane = 0, other = 0x7fffffff;
            for (int j = 0; j < LANES; ++j)
                if (top[r][j] < d || (top[r][j] == d && where[r][j] < at)) {
                    d = top[r][j];
                    at = where[r][j];
                    lane = j;
                }
            for (int j = 0; j < LANES; ++j) {
                const int v = j == lane ? next[r][j] : top[r][j];
                other = v < other ? v : other;
            }
            const size_t out = (size_t)b[4] + row + r - b[0];
            best.data[out] = d;
            second.data[out] = other < LARGEST / 2 ? other : LARGEST;
            index.data[out] = at;
        }
    }
}
