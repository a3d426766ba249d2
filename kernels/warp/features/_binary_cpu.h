// Scores of FAST corners of a row: the largest threshold under which 9 neighbouring pixels of the
// circle are all brighter, or all darker; 0 where that is not above `threshold`.
void score_row(int row, wp::array_t<wp::uint8> src, int threshold, int margin,
               wp::array_t<wp::uint8> scores) {
    const int height = src.shape[0], width = src.shape[1];
    typedef wp::uint8 byte;
    byte* out = scores.data + (size_t)row * width;
    __builtin_memset(out, 0, width);
    if (row < margin || row >= height - margin || width <= 2 * margin) return;
    const byte* c = src.data + (size_t)row * width;
    const long w = width;
    const long at[16] = {-3 * w,    -3 * w + 1, -2 * w + 2, -w + 3,    3,         w + 3,
                         2 * w + 2, 3 * w + 1,  3 * w,      3 * w - 1, 2 * w - 2, w - 3,
                         -3,        -w - 3,     -2 * w - 2, -3 * w - 1};
    const byte least = (byte)threshold;
#pragma clang loop vectorize(assume_safety)
    for (int x = margin; x < width - margin; ++x) {
        const byte v = c[x];
        byte best = 0;
#pragma unroll
        for (int dark = 0; dark < 2; ++dark) {
            byte d[16], two[16], four[16];
#pragma unroll
            for (int k = 0; k < 16; ++k) {
                const byte p = c[x + at[k]];
                const byte a = dark ? v : p, b = dark ? p : v;
                d[k] = a > b ? (byte)(a - b) : (byte)0;
            }
#pragma unroll
            for (int k = 0; k < 16; ++k) two[k] = d[k] < d[(k + 1) % 16] ? d[k] : d[(k + 1) % 16];
#pragma unroll
            for (int k = 0; k < 16; ++k)
                four[k] = two[k] < two[(k + 2) % 16] ? two[k] : two[(k + 2) % 16];
#pragma unroll
            for (int k = 0; k < 16; ++k) {
                const byte e = four[k] < four[(k + 4) % 16] ? four[k] : four[(k + 4) % 16];
                const byte n = e < d[(k + 8) % 16] ? e : d[(k + 8) % 16];
                best = n > best ? n : best;
            }
        }
        out[x] = best > least ? best : (byte)0;
    }
}

// Mark the scores of a row that none of the eight around exceeds; of equal ones the first.
void mark_row(int row, wp::array_t<wp::uint8> scores, wp::array_t<int> words) {
    const int height = scores.shape[0], width = scores.shape[1], stored = words.shape[2];
    int* out = words.data + (size_t)row * stored;
    __builtin_memset(out, 0, 4 * (size_t)stored);
    if (row == 0 || row == height - 1) return;
    const wp::uint8* s = scores.data + (size_t)row * width;
    for (int x = 1; x < width - 1; ++x) {
        const wp::uint8 v = s[x];
        if (!v) continue;
        const wp::uint8 *a = s + x - width, *b = s + x + width;
        if (v > a[-1] && v > a[0] && v > a[1] && v > s[x - 1] && v >= s[x + 1] && v >= b[-1] &&
            v >= b[0] && v >= b[1])
            out[x >> 5] |= (int)(1u << (x & 31));
    }
}

// Bytes of a row of values: rounded and cut off.
void round_row(int row, wp::array_t<float> src, wp::array_t<wp::uint8> dst) {
#pragma clang fp contract(off)
    const int width = dst.shape[1];
    const float* from = src.data + (size_t)row * width;
    wp::uint8* to = dst.data + (size_t)row * width;
    for (int x = 0; x < width; ++x) {
        const float v = from[x] > 0.0f ? from[x] : 0.0f;
        to[x] = (wp::uint8)(int)((v < 255.0f ? v : 255.0f) + 0.5f);
    }
}

// Values of a row of bytes.
void widen_row(int row, wp::array_t<wp::uint8> src, wp::array_t<float> dst) {
    const int width = dst.shape[1];
    const wp::uint8* from = src.data + (size_t)row * width;
    float* to = dst.data + (size_t)row * width;
    for (int x = 0; x < width; ++x) to[x] = (float)from[x];
}
