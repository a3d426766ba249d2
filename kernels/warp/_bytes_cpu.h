// needs LANES, ROWS
// Products of rows of unsigned bytes with those of 16 others, of signed bytes, at once. The others
// lie side by side: 4 bytes of the first, of the second, and so on, then the next 4 bytes of each.
struct Bytes {
    typedef int Lanes __attribute__((vector_size(4 * LANES)));

    // Place of byte k of one of the others.
    static int place(int lane, int k) { return (k / 4 * LANES + lane) * 4 + k % 4; }

    // Add the products to `start`.
    static inline __attribute__((always_inline)) void multiply(const unsigned char* const* rows,
                                                               const void* others, int size,
                                                               Lanes* dots, Lanes start = {}) {
        for (int r = 0; r < ROWS; ++r) dots[r] = start;
        for (int k = 0; k < size; k += 4) {
#if defined(__AVX512VNNI__)
            const Lanes other = *(const Lanes*)((const char*)others + (size_t)k * LANES);
#pragma unroll
            for (int r = 0; r < ROWS; ++r) {
                int own;
                __builtin_memcpy(&own, rows[r] + k, 4);
                dots[r] = (Lanes)__builtin_ia32_vpdpbusd512(
                    (__attribute__((vector_size(64))) int)dots[r], (Lanes){} + own, other);
            }
#else
            const signed char* other = (const signed char*)others + (size_t)k * LANES;
            for (int r = 0; r < ROWS; ++r) {
                const int a0 = rows[r][k], a1 = rows[r][k + 1];
                const int a2 = rows[r][k + 2], a3 = rows[r][k + 3];
                for (int j = 0; j < LANES; ++j)
                    dots[r][j] += a0 * other[4 * j] + a1 * other[4 * j + 1] +
                                  a2 * other[4 * j + 2] + a3 * other[4 * j + 3];
            }
#endif
        }
    }

    // Bits of the lanes that are at least `low`.
    static inline __attribute__((always_inline)) unsigned int reached(Lanes values, int low) {
#if defined(__AVX512F__)
        const int not_less = 5;
        return (unsigned short)__builtin_ia32_cmpd512_mask(
            (__attribute__((vector_size(64))) int)values, (Lanes){} + low, not_less, (short)-1);
#else
        unsigned int bits = 0;
        for (int j = 0; j < LANES; ++j) bits |= (unsigned int)(values[j] >= low) << j;
        return bits;
#endif
    }

    // Product of unsigned with signed bytes, a multiple of 32.
    static inline __attribute__((always_inline)) int product(const unsigned char* a,
                                                             const signed char* b, int size) {
#if defined(__AVX512VNNI__) && defined(__AVX512VL__)
        typedef int Eight __attribute__((vector_size(32)));
        Eight sum = {};
        for (int k = 0; k < size; k += 32) {
            Eight own, other;
            __builtin_memcpy(&own, a + k, 32);
            __builtin_memcpy(&other, b + k, 32);
            sum = (Eight)__builtin_ia32_vpdpbusd256(sum, own, other);
        }
        return __builtin_reduce_add(sum);
#else
        int sum = 0;
        for (int k = 0; k < size; ++k) sum += a[k] * b[k];
        return sum;
#endif
    }
};
