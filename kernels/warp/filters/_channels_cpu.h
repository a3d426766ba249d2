// needs SCALAR
// The first channels of an image as planes. The rows of a slab are rows of the image.
void split(int slab, int first, int last, wp::array_t<SCALAR> src, wp::array_t<SCALAR> planes) {
    const int height = src.shape[0], width = src.shape[1], step = src.shape[2];
    for (int row = first; row < last; ++row) {
        const SCALAR* __restrict__ from = src.data + (size_t)row * width * step;
        for (int c = 0; c < planes.shape[0]; ++c) {
            SCALAR* __restrict__ to = planes.data + ((size_t)c * height + row) * width;
            // A step that the compiler knows becomes shuffles of whole vectors.
            if (step == 3)
                for (int x = 0; x < width; ++x) to[x] = from[3 * x + c];
            else
                for (int x = 0; x < width; ++x) to[x] = from[step * x + c];
        }
    }
}

// The gradient of the channel where it is longest, of the pixels of a slab of rows. Lengths with
// norm 0 are sums, else squares. Without a branch, the loop becomes vector code.
void longest(int slab, int first, int last, wp::array_t<float> dys, wp::array_t<float> dxs,
             int norm, wp::array_t<float> dy, wp::array_t<float> dx) {
#pragma clang fp contract(off)
    const size_t width = dy.shape[1], size = dy.shape[0] * width;
    for (size_t row = first; row < (size_t)last; ++row) {
        float* __restrict__ down = dy.data + row * width;
        float* __restrict__ along = dx.data + row * width;
        for (int c = 0; c < dys.shape[0]; ++c) {
            const float* __restrict__ other_down = dys.data + c * size + row * width;
            const float* __restrict__ other_along = dxs.data + c * size + row * width;
#pragma clang loop vectorize(assume_safety)
            for (size_t x = 0; x < width; ++x) {
                const float v = other_down[x], u = other_along[x], b = down[x], a = along[x];
                const float length = norm ? u * u + v * v : wp::abs(u) + wp::abs(v);
                const float most = norm ? a * a + b * b : wp::abs(a) + wp::abs(b);
                const bool longer = c == 0 || length > most;
                down[x] = longer ? v : b;
                along[x] = longer ? u : a;
            }
        }
    }
}
