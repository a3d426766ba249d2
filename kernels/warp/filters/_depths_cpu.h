// needs SCALAR
// Integers as floats. The rows of a slab are rows of the image.
void widen(int slab, int first, int last, wp::array_t<SCALAR> src, wp::array_t<float> dst) {
    const size_t width = src.shape[1];
    const SCALAR* __restrict__ from = src.data;
    float* __restrict__ to = dst.data;
#pragma clang loop vectorize(assume_safety)
    for (size_t i = first * width; i < last * width; ++i) to[i] = (float)(int)from[i];
}

// needs SCALAR MOST
// Floats as the nearest integers, the even one of two, within [0, MOST]; NaN becomes 0.
void narrow(int slab, int first, int last, wp::array_t<float> src, wp::array_t<SCALAR> dst) {
    const size_t width = src.shape[1];
    const float* __restrict__ from = src.data;
    SCALAR* __restrict__ to = dst.data;
    for (size_t i = first * width; i < last * width; ++i) {
        // Below 2^23 the sum drops the fraction, by the rounding of float32.
        float value = from[i] > 0.0f ? from[i] : 0.0f;
        value = value < MOST ? value : MOST;
        to[i] = (SCALAR)(int)((value + 8388608.0f) - 8388608.0f);
    }
}
