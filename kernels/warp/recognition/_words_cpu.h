#include "../_bytes_cpu.h"
#include "_coarse_cpu.h"

// needs LANES
// Lay the means of 16 words side by side, and behind them 4 bytes that a bound needs: the lengths of
// the errors and of the three differences. `sums` has -128 times the sum of the means, to
// which is added what three bytes do not hold; the length of the means; and 128 times the sum of the
// word.
void pack_group(int group, wp::array_t<wp::int8> words, wp::array_t<wp::int8> packed,
                wp::array_t<int> sums) {
    const int count = words.shape[0], size = words.shape[1];
    wp::int8* out = packed.data + (size_t)group * packed.shape[1];
    int* known = sums.data + (size_t)group * 3 * LANES;
    for (int j = 0; j < LANES; ++j) {
        const int word = group * LANES + j;
        if (word >= count) {
            // The smallest bound, below every threshold.
            for (int k = 0; k < packed.shape[1] / LANES; ++k) out[Bytes::place(j, k)] = 0;
            known[j] = -0x3f000000, known[LANES + j] = known[2 * LANES + j] = 0;
            continue;
        }
        const wp::int8* from = words.data + (size_t)word * size;
        Coarse own;
        own.see((const signed char*)from, size);
        int sum = 0, all = 0;
        for (int k = 0; k < size; ++k) all += from[k];
        for (int k = 0; k < own.size; ++k) {
            out[Bytes::place(j, k)] = own.mean[k];
            sum += own.mean[k];
        }
        out[Bytes::place(j, own.size)] = own.error;
        int missing = 0;
        for (int k = 0; k < 3; ++k) {
            const int rest = (own.rest[k] + 1) / 2;
            out[Bytes::place(j, own.size + 1 + k)] = rest < 127 ? rest : 127;
            missing += rest > 127 ? 255 * (rest - 127) : 0;
        }
        known[j] = missing - 128 * sum;
        known[LANES + j] = own.length;
        known[2 * LANES + j] = 128 * all;
    }
}

// needs LANES, MOST
// The best words of the patches of a slab, eight at a time.
//
// Coarse products bound the exact ones from above. They are computed for all words, and the exact
// ones for those words alone whose bound reaches the worst of the best so far. A quarter of the bound
// in _coarse_cpu.h is one sum of products of bytes: those of the means, of |m| / 4 with |S'|, and of
// halves of the other lengths, rounded up. What bytes do not hold is added to the sum, or left to `beyond`.
void match_rows(int first, int last, wp::array_t<wp::int8> patches, wp::array_t<wp::int8> words,
                wp::array_t<wp::int8> packed, wp::array_t<int> sums, int least,
                wp::array_t<int> products, wp::array_t<int> matches) {
    enum { CHUNK = 128, AT_ONCE = 4, HALF_LENGTH = 1700 };  // half the length of 640 bytes
    typedef Bytes::Lanes lanes;
    const int size = patches.shape[1], most = matches.shape[1], groups = packed.shape[0];
    const auto load = [](const int* at)
                          __attribute__((always_inline)) { return *(const lanes*)at; };
    // The best words of a patch, each as a product and, below it, the index from the largest down:
    // the largest product first, the smallest index in a tie.
    struct Best {
        wp::int64 key[MOST];

        static wp::int64 of(int product, int word) {
            return ((wp::int64)product << 32) + (0xffffffffu - (unsigned int)word);
        }
    };
    lanes step;
    for (int j = 0; j < LANES; ++j) step[j] = j;
    const signed char* all = (const signed char*)words.data;
    int longest = 0;
    for (int g = 0; g < groups; ++g) {
        const int length = __builtin_reduce_max(load(sums.data + (size_t)(3 * g + 1) * LANES));
        longest = length > longest ? length : longest;
    }
    alignas(64) lanes bounds[ROWS][CHUNK];
    for (int row = first; row < last;) {
        // Patches that are not flat; flat ones have the product 0 with every word.
        int of[ROWS], count = 0;
        Coarse own;
        int beyond[ROWS];  // what is missing in the bounds of a patch
        // The product of bytes takes unsigned with signed ones: 128 is added to the first.
        wp::uint8 means[ROWS][LARGEST / 4 + 4], pixels[ROWS][LARGEST];
        const wp::uint8* rows[ROWS];
        Best best[ROWS];
        for (; row < last && count < ROWS; ++row) {
            const signed char* patch = (const signed char*)patches.data + (size_t)row * size;
            signed char any = 0;
            for (int k = 0; k < size; ++k) any |= patch[k];
            if (least > 0 && !any) {
                for (int m = 0; m < most; ++m) {
                    products.data[(size_t)row * most + m] = 0;
                    matches.data[(size_t)row * most + m] = -1;
                }
                continue;
            }
            own.see(patch, size);
            wp::uint8* mean = means[count];
            for (int k = 0; k < own.size; ++k) mean[k] = own.mean[k] ^ 128;
            const int length = (own.length + (own.error + 3) / 4 + 3) / 4;
            mean[own.size] = length < 255 ? length : 255;
            beyond[count] = (own.error * longest + 3) / 4;
            if (length > 255) beyond[count] += (length - 255) * 127;
            for (int k = 0; k < 3; ++k) {
                const int rest = (own.rest[k] + 1) / 2;
                mean[own.size + 1 + k] = rest < 255 ? rest : 255;
                if (rest > 255) beyond[count] += (rest - 255) * HALF_LENGTH;
            }
            for (int k = 0; k < size; ++k) pixels[count][k] = patch[k] ^ 128;
            for (int m = 0; m < MOST; ++m) best[count].key[m] = Best::of(least - 1, 0);
            of[count++] = row;
        }
        if (!count) break;
        for (int r = 0; r < ROWS; ++r) rows[r] = means[r < count ? r : 0];
        for (int begin = 0; begin < groups; begin += CHUNK) {
            const int number = groups - begin < CHUNK ? groups - begin : CHUNK;
            lanes top[ROWS], where[ROWS];
            for (int r = 0; r < ROWS; ++r) top[r] = (lanes){} - 0x7fffffff, where[r] = (lanes){};
            for (int g = 0; g < number; ++g) {
                const wp::int8* p = packed.data + (size_t)(begin + g) * packed.shape[1];
                const lanes here = step + g * LANES;
                lanes dots[ROWS];
                Bytes::multiply(rows, p, packed.shape[1] / LANES, dots,
                                load(sums.data + (size_t)(begin + g) * 3 * LANES));
#pragma unroll
                for (int r = 0; r < ROWS; ++r) {
                    bounds[r][g] = dots[r];
                    where[r] = dots[r] > top[r] ? here : where[r];
                    top[r] = dots[r] > top[r] ? dots[r] : top[r];
                }
            }
            for (int r = 0; r < count; ++r) {
                Best& b = best[r];
                const auto floor = [&]() {
                    const int worst = (int)(b.key[most - 1] >> 32);
                    return worst > least ? worst : least;
                };
                int chosen[CHUNK * LANES], number_chosen = 0;
                const auto see = [&]() {
                    int dots[CHUNK * LANES];
                    for (int i = 0; i < number_chosen; ++i) {
                        const int index = begin * LANES + chosen[i];
                        dots[i] =
                            Bytes::product(pixels[r], all + (size_t)index * size, size) -
                            sums.data[((size_t)(index / LANES) * 3 + 2) * LANES + index % LANES];
                    }
                    for (int i = 0; i < number_chosen; ++i) {
                        wp::int64 key = Best::of(dots[i], begin * LANES + chosen[i]);
                        if (key < b.key[most - 1]) continue;
#pragma unroll
                        for (int m = 0; m < MOST; ++m) {
                            const wp::int64 other = b.key[m];
                            b.key[m] = other > key ? other : key;
                            key = other > key ? key : other;
                        }
                    }
                    number_chosen = 0;
                };
                // Four times a bound, and what is missing in it, is at least the product.
                const auto needed = [&]() { return ((floor() + 3) >> 2) - beyond[r]; };
                // First the best bound of each lane: it raises the floor for the others.
                for (int j = 0; j < LANES; ++j) {
                    if (top[r][j] < needed()) continue;
                    ((int*)bounds[r])[where[r][j]] = -0x7fffffff;
                    chosen[number_chosen++] = where[r][j];
                }
                see();
                const int low = needed();
                for (int g = number; g < CHUNK && g % AT_ONCE; ++g)
                    bounds[r][g] = (lanes){} - 0x7fffffff;
                for (int g = 0; g < number; g += AT_ONCE) {
                    wp::uint64 left = 0;
#pragma unroll
                    for (int k = 0; k < AT_ONCE; ++k)
                        left |= (wp::uint64)Bytes::reached(bounds[r][g + k], low) << k * LANES;
                    for (; left; left &= left - 1)
                        chosen[number_chosen++] = g * LANES + __builtin_ctzll(left);
                }
                see();
            }
        }
        for (int r = 0; r < count; ++r)
            for (int m = 0; m < most; ++m) {
                const size_t out = (size_t)of[r] * most + m;
                const int product = (int)(best[r].key[m] >> 32);
                const int word = (int)(0xffffffffu - (unsigned int)best[r].key[m]);
                products.data[out] = product >= least ? product : 0;
                matches.data[out] = product >= least ? word : -1;
            }
    }
}
