// needs LANES, ROWS
// Products of rows of unsigned bytes with those of 16 others, of signed bytes, at once. The others
// lie side by side: 4 bytes of the first, of the second, and so on, then the next 4 bytes of each.
struct Bytes {
    typedef int Lanes __attribute__((vector_size(4 * LANES)));

#if defined(__AVX2__)
    typedef int Eight __attribute__((vector_size(32)));
    typedef short Pairs __attribute__((vector_size(32)));

    // Products of words, added in pairs.
    static inline __attribute__((always_inline)) Eight added(Pairs a, Pairs b) {
        return (Eight)__builtin_ia32_pmaddwd256(a, b);
    }
#endif

    // Place of byte k of one of the others.
    static int place(int lane, int k) { return (k / 4 * LANES + lane) * 4 + k % 4; }

    // Add the products to `start`.
    static inline __attribute__((always_inline)) void multiply(const unsigned char* const* rows,
                                                               const void* others, int size,
                                                               Lanes* dots, Lanes start = {}) {
        for (int r = 0; r < ROWS; ++r) dots[r] = start;
#if defined(__AVX512VNNI__)
        for (int k = 0; k < size; k += 4) {
            const Lanes other = *(const Lanes*)((const char*)others + (size_t)k * LANES);
#pragma unroll
            for (int r = 0; r < ROWS; ++r) {
                int own;
                __builtin_memcpy(&own, rows[r] + k, 4);
                dots[r] = (Lanes)__builtin_ia32_vpdpbusd512(
                    (__attribute__((vector_size(64))) int)dots[r], (Lanes){} + own, other);
            }
        }
#elif defined(__AVX2__)
        // Sums of two products of words, because those of bytes are cut off. Eight of the others
        // at a time: so many sums fit the registers.
        enum { CHUNK = 32, EIGHT = 32, EVEN = 0x00ff00ff };
        for (int begin = 0; begin < size / 4; begin += CHUNK) {
            const int count = size / 4 - begin < CHUNK ? size / 4 - begin : CHUNK;
            int even[ROWS][CHUNK], odd[ROWS][CHUNK];
            for (int r = 0; r < ROWS; ++r)
                for (int k = 0; k < count; ++k) {
                    int own;
                    __builtin_memcpy(&own, rows[r] + 4 * (begin + k), 4);
                    even[r][k] = own & EVEN;
                    odd[r][k] = own >> 8 & EVEN;
                }
            for (int half = 0; half < LANES / 8; ++half) {
                Eight sums[ROWS];
                for (int r = 0; r < ROWS; ++r)
                    __builtin_memcpy(&sums[r], (char*)&dots[r] + EIGHT * half, EIGHT);
                for (int k = 0; k < count; ++k) {
                    Pairs other;
                    const char* from = (const char*)others + (size_t)(begin + k) * 4 * LANES;
                    __builtin_memcpy(&other, from + EIGHT * half, EIGHT);
                    const Pairs low = other << 8 >> 8, high = other >> 8;
#pragma unroll
                    for (int r = 0; r < ROWS; ++r)
                        sums[r] += added(low, (Pairs)((Eight){} + even[r][k])) +
                                   added(high, (Pairs)((Eight){} + odd[r][k]));
                }
                for (int r = 0; r < ROWS; ++r)
                    __builtin_memcpy((char*)&dots[r] + EIGHT * half, &sums[r], EIGHT);
            }
        }
#else
        for (int k = 0; k < size; k += 4) {
            const signed char* other = (const signed char*)others + (size_t)k * LANES;
            for (int r = 0; r < ROWS; ++r) {
                const int a0 = rows[r][k], a1 = rows[r][k + 1];
                const int a2 = rows[r][k + 2], a3 = rows[r][k + 3];
                for (int j = 0; j < LANES; ++j)
                    dots[r][j] += a0 * other[4 * j] + a1 * other[4 * j + 1] +
                                  a2 * other[4 * j + 2] + a3 * other[4 * j + 3];
            }
        }
#endif
    }

    // Bits of the lanes that are at least `low`.
    static inline __attribute__((always_inline)) unsigned int reached(Lanes values, int low) {
#if defined(__AVX512F__)
        const int not_less = 5;
        return (unsigned short)__builtin_ia32_cmpd512_mask(
            (__attribute__((vector_size(64))) int)values, (Lanes){} + low, not_less, (short)-1);
#else
        unsigned int bits = 0;
#if defined(__AVX2__)
        for (int half = 0; half < LANES / 8; ++half) {
            Eight eight;
            __builtin_memcpy(&eight, (const char*)&values + sizeof eight * half, sizeof eight);
            const auto mask = (__attribute__((vector_size(32))) float)(eight >= low);
            bits |= (unsigned int)__builtin_ia32_movmskps256(mask) << 8 * half;
        }
#else
        for (int j = 0; j < LANES; ++j) bits |= (unsigned int)(values[j] >= low) << j;
#endif
        return bits;
#endif
    }

    // Product of unsigned with signed bytes, a multiple of 32.
    static inline __attribute__((always_inline)) int product(const unsigned char* a,
                                                             const signed char* b, int size) {
#if defined(__AVX512VNNI__) && defined(__AVX512VL__)
        Eight sum = {};
        for (int k = 0; k < size; k += 32) {
            Eight own, other;
            __builtin_memcpy(&own, a + k, 32);
            __builtin_memcpy(&other, b + k, 32);
            sum = (Eight)__builtin_ia32_vpdpbusd256(sum, own, other);
        }
        return __builtin_reduce_add(sum);
#elif defined(__AVX2__)
        Eight sum = {};
        for (int k = 0; k < size; k += 32) {
            Pairs own, other;
            __builtin_memcpy(&own, a + k, 32);
            __builtin_memcpy(&other, b + k, 32);
            sum += added(own & 255, other << 8 >> 8);
            sum += added((Pairs)((__attribute__((vector_size(32))) unsigned short)own >> 8),
                         other >> 8);
        }
        return __builtin_reduce_add(sum);
#else
        int sum = 0;
        for (int k = 0; k < size; ++k) sum += a[k] * b[k];
        return sum;
#endif
    }
};
