// Gray codes on CUDA: QUAD neighbouring pixels a thread, all of whose frames are read once.

#include "_codes_cuda.h"

// needs TYPE, NONE, QUAD
void decode_quad(wp::array_t<TYPE> frames, int begin, int bits, int size, float margin, bool joins,
                 wp::array_t<int> codes, wp::array_t<wp::uint8> valid) {
    struct alignas(QUAD * sizeof(TYPE)) Pixels {
        TYPE at[QUAD];
    };
    const size_t plane = (size_t)codes.shape[0] * codes.shape[1];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * QUAD;
    if (first >= plane) return;
    const bool whole = plane % QUAD == 0 && (size_t)frames.data % sizeof(Pixels) == 0;
    float least[QUAD];
    int code[QUAD], bit[QUAD];
    for (int i = 0; i < QUAD; ++i) {
        least[i] = __int_as_float(0x7f800000);
        code[i] = bit[i] = 0;
    }
#pragma unroll 4
    for (int k = 0; k < bits; ++k) {
        const TYPE* from = frames.data + (begin + 2 * k) * plane + first;
        Pixels pattern, inverse;
        if (whole) {
            pattern = *(const Pixels*)from;
            inverse = *(const Pixels*)(from + plane);
        } else {
            for (int i = 0; i < QUAD; ++i) {
                const bool inside = first + i < plane;
                pattern.at[i] = inside ? from[i] : (TYPE)0;
                inverse.at[i] = inside ? from[plane + i] : (TYPE)0;
            }
        }
        for (int i = 0; i < QUAD; ++i) {
            const float apart = fabsf((float)pattern.at[i] - (float)inverse.at[i]);
            // A NaN is no code: it makes the least difference NaN, for good.
            least[i] = apart < least[i] || apart != apart ? apart : least[i];
            bit[i] ^= (float)pattern.at[i] > (float)inverse.at[i];
            code[i] = 2 * code[i] + bit[i];
        }
    }
    for (int i = 0; i < QUAD; ++i) code[i] = least[i] > margin && code[i] < size ? code[i] : NONE;
#pragma unroll
    for (int i = 0; i < QUAD; i += 4)
        Codes::store(code + i, first + i, plane, joins, codes.data, valid.data);
}

// needs NONE, AHEAD
// The same for bytes and at most 16 bits: four pixels a thread, and halves of a word are two of them.
void decode_bytes(wp::array_t<wp::uint8> frames, int begin, int bits, int size, float margin,
                  bool joins, wp::array_t<int> codes, wp::array_t<wp::uint8> valid) {
    const unsigned HALVES = 0x00ff00ffu;
    const size_t plane = (size_t)codes.shape[0] * codes.shape[1];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * 4;
    if (first >= plane) return;
    unsigned least[2] = {HALVES, HALVES}, code[2] = {0, 0};
    const auto take = [&](unsigned p, unsigned q) {
        const unsigned apart = __vabsdiffu4(p, q);
#pragma unroll
        for (int i = 0; i < 2; ++i) {
            least[i] = __vminu2(least[i], apart >> 8 * i & HALVES);
            // Bit 8 of a half: the inverse is at least as bright.
            const unsigned dark = (q >> 8 * i & HALVES) + 0x01000100u - (p >> 8 * i & HALVES);
            code[i] = 2 * code[i] + (dark >> 8 & 0x00010001u);
        }
    };
    const wp::uint8* from = frames.data + begin * plane + first;
    if (plane % 4 == 0 && (size_t)frames.data % 4 == 0) {
        const unsigned* words = (const unsigned*)from;
        const size_t step = plane / 4;
        int k = 0;
        // The frames of AHEAD bits are asked for before the first of them is used.
        for (; k + AHEAD <= bits; k += AHEAD, words += 2 * AHEAD * step) {
            unsigned p[AHEAD], q[AHEAD];
#pragma unroll
            for (int n = 0; n < AHEAD; ++n)
                p[n] = words[2 * n * step], q[n] = words[(2 * n + 1) * step];
#pragma unroll
            for (int n = 0; n < AHEAD; ++n) take(p[n], q[n]);
        }
        for (; k < bits; ++k, words += 2 * step) take(words[0], words[step]);
    } else {
        const int count = plane - first < 4 ? (int)(plane - first) : 4;
        for (int k = 0; k < bits; ++k, from += 2 * plane) {
            unsigned p = 0, q = 0;
            for (int i = 0; i < count; ++i)
                p |= (unsigned)from[i] << 8 * i, q |= (unsigned)from[plane + i] << 8 * i;
            take(p, q);
        }
    }
    const int most = margin < 255.0f ? (int)margin : 255;  // margins are not negative
    const unsigned ones = ((1u << bits) - 1) * 0x10001u;
    int found[4];
#pragma unroll
    for (int i = 0; i < 2; ++i) {
        unsigned both = ~code[i] & ones;
        // The parity of a bit and of all above it.
        both ^= both >> 1 & 0x7fff7fffu;
        both ^= both >> 2 & 0x3fff3fffu;
        both ^= both >> 4 & 0x0fff0fffu;
        both ^= both >> 8 & 0x00ff00ffu;
        const int low = both & 0xffff, high = both >> 16;
        const int near = least[i] & 0xffff, far = least[i] >> 16;
        found[i] = near > most && low < size ? low : NONE;
        found[2 + i] = far > most && high < size ? high : NONE;
    }
    Codes::store(found, first, plane, joins, codes.data, valid.data);
}

// needs TYPE
// Four neighbouring pixels without enough light are not valid.
void accept_four(wp::array_t<TYPE> white, wp::array_t<TYPE> black, float contrast,
                 wp::array_t<wp::uint8> valid) {
    const size_t plane = (size_t)valid.shape[0] * valid.shape[1];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * 4;
    for (size_t i = first; i < first + 4 && i < plane; ++i)
        valid.data[i] &= (float)white.data[i] - (float)black.data[i] > contrast;
}
