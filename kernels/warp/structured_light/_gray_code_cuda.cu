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

// needs NONE, WORDS
// The same for bytes and at most 16 bits: halves of a word are two of its four pixels.
void decode_bytes(wp::array_t<wp::uint8> frames, int begin, int bits, int size, float margin,
                  bool joins, wp::array_t<int> codes, wp::array_t<wp::uint8> valid) {
    struct alignas(4 * WORDS) Pixels {
        unsigned at[WORDS];
    };
    enum { QUAD = 4 * WORDS };
    const unsigned HALVES = 0x00ff00ffu;
    const size_t plane = (size_t)codes.shape[0] * codes.shape[1];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * QUAD;
    if (first >= plane) return;
    const bool whole = plane % QUAD == 0 && (size_t)frames.data % sizeof(Pixels) == 0;
    unsigned least[2][WORDS], code[2][WORDS];
    for (int w = 0; w < WORDS; ++w) {
        least[0][w] = least[1][w] = HALVES;
        code[0][w] = code[1][w] = 0;
    }
    const auto read = [&](const wp::uint8* from) {
        Pixels pixels;
        if (whole) return *(const Pixels*)from;
        for (int w = 0; w < WORDS; ++w) pixels.at[w] = 0;
        for (int i = 0; i < QUAD; ++i)
            if (first + i < plane) pixels.at[i / 4] |= (unsigned)from[i] << 8 * (i % 4);
        return pixels;
    };
#pragma unroll 4
    for (int k = 0; k < bits; ++k) {
        const wp::uint8* from = frames.data + (begin + 2 * k) * plane + first;
        const Pixels pattern = read(from), inverse = read(from + plane);
#pragma unroll
        for (int w = 0; w < WORDS; ++w) {
            const unsigned p = pattern.at[w], q = inverse.at[w], apart = __vabsdiffu4(p, q);
#pragma unroll
            for (int i = 0; i < 2; ++i) {
                least[i][w] = __vminu2(least[i][w], apart >> 8 * i & HALVES);
                // Bit 8 of a half: the inverse is at least as bright.
                const unsigned dark = (q >> 8 * i & HALVES) + 0x01000100u - (p >> 8 * i & HALVES);
                code[i][w] = 2 * code[i][w] + (dark >> 8 & 0x00010001u);
            }
        }
    }
    const int most = margin < 255.0f ? (int)margin : 255;  // margins are not negative
    const unsigned ones = ((1u << bits) - 1) * 0x10001u;
    int found[QUAD];
#pragma unroll
    for (int w = 0; w < WORDS; ++w) {
#pragma unroll
        for (int i = 0; i < 2; ++i) {
            unsigned both = ~code[i][w] & ones;
            // The parity of a bit and of all above it.
            both ^= both >> 1 & 0x7fff7fffu;
            both ^= both >> 2 & 0x3fff3fffu;
            both ^= both >> 4 & 0x0fff0fffu;
            both ^= both >> 8 & 0x00ff00ffu;
            const int low = both & 0xffff, high = both >> 16;
            const int near = least[i][w] & 0xffff, far = least[i][w] >> 16;
            found[4 * w + i] = near > most && low < size ? low : NONE;
            found[4 * w + 2 + i] = far > most && high < size ? high : NONE;
        }
    }
#pragma unroll
    for (int i = 0; i < QUAD; i += 4)
        Codes::store(found + i, first + i, plane, joins, codes.data, valid.data);
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
