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
    if (plane % QUAD == 0 && (size_t)codes.data % 16 == 0) {
        for (int i = 0; i < QUAD; i += 4)
            *(int4*)(codes.data + first + i) =
                make_int4(code[i], code[i + 1], code[i + 2], code[i + 3]);
    } else {
        for (int i = 0; i < QUAD && first + i < plane; ++i) codes.data[first + i] = code[i];
    }
}

// needs TYPE
// Which of four neighbouring pixels have codes and enough light.
void accept_four(wp::array_t<TYPE> white, wp::array_t<TYPE> black, float contrast,
                 wp::array_t<int> columns, wp::array_t<int> rows, wp::array_t<wp::uint8> valid) {
    const size_t plane = (size_t)valid.shape[0] * valid.shape[1];
    const size_t first = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * 4;
    const bool lights = white.shape[0] == valid.shape[0] && white.shape[1] == valid.shape[1];
    const bool whole = plane % 4 == 0 && (size_t)columns.data % 16 == 0 &&
                       (size_t)rows.data % 16 == 0 && (size_t)valid.data % 4 == 0;
    if (first >= plane) return;
    if (whole && !lights) {
        const int4 a = *(const int4*)(columns.data + first), b = *(const int4*)(rows.data + first);
        *(uchar4*)(valid.data + first) =
            make_uchar4((a.x | b.x) >= 0, (a.y | b.y) >= 0, (a.z | b.z) >= 0, (a.w | b.w) >= 0);
        return;
    }
    for (size_t i = first; i < first + 4 && i < plane; ++i) {
        const bool lit = !lights || (float)white.data[i] - (float)black.data[i] > contrast;
        valid.data[i] = lit && columns.data[i] >= 0 && rows.data[i] >= 0;
    }
}
