#include "_adder_cpu.h"

// The rows of a slab are rows of the accumulators, ring after ring. The votes of a ring are a sum
// of copies of the mask, moved by the ring's offsets. The number of offsets is a multiple of eight,
// one per octant. Bit p of the counts of 512 pixels is `sums[p]`.
void vote_rings(int slab, int first, int last, wp::array_t<wp::uint8> bits,
                wp::array_t<wp::int64> places, wp::array_t<int> starts, bool shares,
                wp::array_t<int> votes) {
    typedef Adder::Bits Bits;
    typedef unsigned long long Loaded __attribute__((vector_size(64), aligned(1), may_alias));
    typedef int Counts __attribute__((vector_size(64)));
    typedef float Shares __attribute__((vector_size(64)));
    typedef int Stored __attribute__((vector_size(64), aligned(4), may_alias));
    const int rows = votes.shape[1], columns = votes.shape[2], pitch = bits.shape[2];
    const Counts lane = {1,      1 << 1, 1 << 2,  1 << 3,  1 << 4,  1 << 5,  1 << 6,  1 << 7,
                         1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
    for (int line = first; line < last; ++line) {
        const int ring = line / rows, row = line % rows;
        const int begin = starts.data[ring], end = starts.data[ring + 1];
        const int planes = 32 - __builtin_clz(end - begin);
        int* out = votes.data + (size_t)line * columns;
        for (int left = 0; left < columns; left += 512) {
            const unsigned char* from = bits.data + (size_t)row * pitch + left / 8;
            const auto moved = [&](int k) -> Bits {
                return *(const Loaded*)(from + places.data[k]);
            };
            Bits sums[20] = {};
            Bits ones = {}, twos = {}, fours = {};
            for (int k = begin; k < end; k += 8) {
                const Bits a = Adder::add(ones, moved(k), moved(k + 1));
                const Bits b = Adder::add(ones, moved(k + 2), moved(k + 3));
                const Bits c = Adder::add(twos, a, b);
                const Bits d = Adder::add(ones, moved(k + 4), moved(k + 5));
                const Bits e = Adder::add(ones, moved(k + 6), moved(k + 7));
                const Bits f = Adder::add(twos, d, e);
                Bits carry = Adder::add(fours, c, f);
                for (int p = 3; p < planes; ++p) {
                    const Bits both = sums[p] & carry;
                    sums[p] ^= carry;
                    carry = both;
                }
            }
            sums[0] = ones;
            sums[1] = twos;
            sums[2] = fours;
            for (int i = 0; i < 32 && left + 16 * i < columns; ++i) {
                Counts count = {};
                for (int p = 0; p < planes; ++p) {
                    unsigned short sixteen = 0;
                    __builtin_memcpy(&sixteen, (const char*)&sums[p] + 2 * i, 2);
                    const Counts set = (((Counts){} + (int)sixteen) & lane) != 0;
                    count += set & (1 << p);
                }
                if (shares) {
                    const Shares share =
                        __builtin_convertvector(count, Shares) / (float)(end - begin);
                    __builtin_memcpy(&count, &share, 64);
                }
                int* to = out + left + 16 * i;
                const int rest = columns - left - 16 * i;
                if (rest >= 16)
                    *(Stored*)to = count;
                else
                    for (int j = 0; j < rest; ++j) to[j] = count[j];
            }
        }
    }
}
