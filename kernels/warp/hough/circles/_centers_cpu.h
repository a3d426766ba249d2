// needs SCALAR
// Means of squares of `factor` x `factor` pixels. The rows of a slab are rows of the result. The
// rows of a square are added first, then its columns.
void shrink(int slab, int first, int last, wp::array_t<SCALAR> src, int factor,
            wp::array_t<float> lines, wp::array_t<float> dst) {
    const int columns = dst.shape[1], width = src.shape[1], used = columns * factor;
    float* __restrict__ line = lines.data + (size_t)slab * width;
    const float share = 1.0f / (factor * factor);
    for (int row = first; row < last; ++row) {
        for (int v = 0; v < factor; ++v) {
            const SCALAR* from = src.data + ((size_t)row * factor + v) * width;
#pragma clang loop vectorize(assume_safety)
            for (int x = 0; x < used; ++x) line[x] = (v ? line[x] : 0.0f) + from[x];
        }
        for (int x = 0; x < columns; ++x) {
            float sum = 0.0f;
            for (int u = 0; u < factor; ++u) sum += line[x * factor + u];
            dst.data[(size_t)row * columns + x] = sum * share;
        }
    }
}

// needs LINE_ONE LINE_BITS
// Votes for centres. The rows of a slab are points; their lines are walked cell by cell in fixed
// point. Each slab has its own accumulator. Side 1 is along the gradient, -1 against it.
void vote_centers(int slab, int first, int last, wp::array_t<float> lines, int low, int high,
                  float scale, int first_side, int last_side, wp::array_t<int> votes) {
#pragma clang fp contract(off)
    const int count = lines.shape[1], height = votes.shape[1], width = votes.shape[2];
    const float *row = lines.data, *column = row + count;
    const float *down = column + count, *along = down + count;
    int* out = votes.data + (size_t)slab * height * width;
    for (int i = 0; i < height * width; ++i) out[i] = 0;
    for (int i = first; i < last; ++i) {
        const int y = (int)__builtin_floorf(row[i] * scale + 0.5f) + LINE_ONE / 2;
        const int x = (int)__builtin_floorf(column[i] * scale + 0.5f) + LINE_ONE / 2;
        const int dy = (int)(down[i] * (float)LINE_ONE), dx = (int)(along[i] * (float)LINE_ONE);
        for (int side = first_side; side >= last_side; side -= 2) {
            int v = y + side * low * dy, u = x + side * low * dx;
            for (int k = low; k <= high; ++k, v += side * dy, u += side * dx) {
                const unsigned r = v >> LINE_BITS, c = u >> LINE_BITS;
                if (r >= (unsigned)height || c >= (unsigned)width) break;
                ++out[r * width + c];
            }
        }
    }
}

// The sum of the accumulators of all slabs.
void add_parts(wp::array_t<int> parts, wp::array_t<float> votes) {
    const size_t size = (size_t)votes.shape[0] * votes.shape[1];
    float* sum = votes.data;
    for (int p = 0; p < parts.shape[0]; ++p) {
        const int* from = parts.data + p * size;
#pragma clang loop vectorize(assume_safety)
        for (size_t i = 0; i < size; ++i) sum[i] = (p ? sum[i] : 0.0f) + (float)from[i];
    }
}
