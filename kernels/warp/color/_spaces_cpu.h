// needs PART, DARKEST, FIRST
// Linear colours of a slab of pixels times a matrix, as bytes of sRGB, PART pixels at once. The upper
// half of a value's bits finds a step in the table; the lower half is added to that.
void encode_linear(int slab, int first, int last, wp::array_t<float> colours,
                   wp::array_t<float> numbers, wp::array_t<int> steps, wp::array_t<wp::uint8> out) {
#pragma clang fp contract(off)
    union Value {
        float real;
        int bits;
        unsigned short halves[2];  // the upper one is the second
    };
    const float* m = numbers.data;
    const int* table = steps.data;
    Value values[3][PART];
    int found[3][PART];
    for (int begin = first; begin < last; begin += PART) {
        const int count = last - begin < PART ? last - begin : PART;
        const float* from = colours.data + 3 * (size_t)begin;
        for (int i = 0; i < count; ++i) {
            const float r = from[3 * i], g = from[3 * i + 1], b = from[3 * i + 2];
#pragma clang loop unroll(full)
            for (int k = 0; k < 3; ++k) {
                const float v = (m[3 * k] * r + m[3 * k + 1] * g) + m[3 * k + 2] * b;
                const float most = v < 1.0f ? v : 1.0f;
                values[k][i].real = v > DARKEST ? most : DARKEST;  // and what is not a number
            }
        }
        for (int k = 0; k < 3; ++k)
#pragma clang loop unroll_count(8)
            for (int i = 0; i < count; ++i) found[k][i] = table[values[k][i].halves[1] - FIRST];
        wp::uint8* to = out.data + 3 * (size_t)begin;
        for (int i = 0; i < count; ++i)
#pragma clang loop unroll(full)
            for (int k = 0; k < 3; ++k)
                to[3 * i + k] = (wp::uint8)((found[k][i] + (values[k][i].bits & 0xffff)) >> 16);
    }
}
