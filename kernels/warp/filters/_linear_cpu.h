// Sum the rows around `row` and around the next, weighted by the taps, into two lines, from column
// `first` to before column `last`. All rows are inside the image, and each is read once.
void pair_down(wp::array_t<Lanes> src, int row, wp::array_t<float> taps, wp::array_t<float> lines,
               int first_line, int margin, int first, int last) {
#pragma clang fp contract(off)
    typedef float Sixteen __attribute__((vector_size(64)));
    typedef float Stored __attribute__((vector_size(64), aligned(4), may_alias));
    const int n = taps.shape[0];
    const size_t pitch = src.strides[0] / 4;
    const float* weight = taps.data;
    const float* top = (const float*)src.data + (size_t)(row - n / 2) * pitch;
    float* one = lines.data + (size_t)first_line * lines.shape[1] + margin;
    float* two = one + lines.shape[1];
    // A parameter of 64 bytes allows the registers of 64 bytes in this function.
    const auto add = [](Sixteen a, Sixteen b) __attribute__((always_inline)) { return a + b; };
    for (int begin = first; begin < last; begin += 64) {
        const int x = begin < last - 64 ? begin : last - 64;
        Sixteen a[4], b[4];
        const float* from = top + x;
        for (int k = 0; k < 4; ++k)
            a[k] = weight[0] * *(const Stored*)(from + 16 * k), b[k] = Sixteen{};
        for (int t = 1; t < n; ++t) {
            from += pitch;
            for (int k = 0; k < 4; ++k) {
                const Sixteen v = *(const Stored*)(from + 16 * k);
                a[k] = add(a[k], weight[t] * v);
                b[k] = add(b[k], weight[t - 1] * v);
            }
        }
        from += pitch;
        for (int k = 0; k < 4; ++k) {
            const Sixteen v = *(const Stored*)(from + 16 * k);
            *(Stored*)(one + x + 16 * k) = a[k];
            *(Stored*)(two + x + 16 * k) = add(b[k], weight[n - 1] * v);
        }
    }
}

// Sum the pixels around each pixel of a line, weighted by the taps.
void along(wp::array_t<float> lines, int line, int step, wp::array_t<float> taps, int size,
           wp::array_t<Wide> dst, int row) {
#pragma clang fp contract(off)
    typedef float Sixteen __attribute__((vector_size(64)));
    typedef float Stored __attribute__((vector_size(64), aligned(4), may_alias));
    const int n = taps.shape[0];
    const float *weight = taps.data, *values = lines.data + (size_t)line * lines.shape[1];
    float* to = (float*)((char*)dst.data + (size_t)row * dst.strides[1]);
    const auto add = [](Sixteen a, Sixteen b) __attribute__((always_inline)) { return a + b; };
    for (int begin = 0; begin < size; begin += 64) {
        const int x = begin < size - 64 ? begin : size - 64;
        Sixteen sums[4] = {};
        const float* from = values + x;
        for (int t = 0; t < n; ++t, from += step)
            for (int k = 0; k < 4; ++k)
                sums[k] = add(sums[k], weight[t] * *(const Stored*)(from + 16 * k));
        for (int k = 0; k < 4; ++k) *(Stored*)(to + x + 16 * k) = sums[k];
    }
}

// needs SCALAR
// Row `row` of an image of integers as floats; row -1 has `cval`.
void widen_row(wp::array_t<SCALAR> src, int row, float cval, wp::array_t<float> dst, int line) {
    const size_t columns = src.shape[1];
    const SCALAR* __restrict__ from = src.data + (size_t)(row < 0 ? 0 : row) * columns;
    float* __restrict__ to = dst.data + (size_t)line * dst.shape[1];
    if (row < 0)
        for (size_t x = 0; x < columns; ++x) to[x] = cval;
    else
        for (size_t x = 0; x < columns; ++x) to[x] = (float)(int)from[x];
}

// needs SCALAR MOST
// A line of floats as a row of integers, rounded as in _depths_cpu.h.
void narrow_row(wp::array_t<float> src, int line, wp::array_t<SCALAR> dst, int row) {
    const size_t columns = dst.shape[1];
    const float* __restrict__ from = src.data + (size_t)line * src.shape[1];
    SCALAR* __restrict__ to = dst.data + (size_t)row * columns;
    for (size_t x = 0; x < columns; ++x) {
        float value = from[x] > 0.0f ? from[x] : 0.0f;
        value = value < MOST ? value : MOST;
        to[x] = (SCALAR)(int)((value + 8388608.0f) - 8388608.0f);
    }
}
