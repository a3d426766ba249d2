// Gray codes on CUDA: QUAD neighbouring pixels a thread, all of whose frames are read once.

// needs TYPE, NONE, QUAD
void decode_quad(wp::array_t<TYPE> frames, int begin, int bits, int size, float margin,
                 wp::array_t<int> codes) {
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
    for (int i = 0; i < QUAD && first + i < plane; ++i)
        codes.data[first + i] = least[i] > margin && code[i] < size ? code[i] : NONE;
}
