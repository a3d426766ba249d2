// needs TYPE
// Comparison n is computed for 64 pixels at once, into byte n / 8; the bytes are joined at the end.
// Lines hold the rows of the image, extended on both sides by their outermost pixels. Row v is in
// line v modulo the height of the window, so each row needs one new line.
void census(int slab, int first, int last, wp::array_t<TYPE> image, int radius_y, int radius_x,
            int spacing, int symmetric, wp::array_t<TYPE> lines, wp::array_t<wp::uint64> bits) {
    typedef TYPE values __attribute__((vector_size(64 * sizeof(TYPE)), aligned(sizeof(TYPE))));
    typedef unsigned char octets __attribute__((vector_size(64)));
    // Clang keeps 64 bytes in one register only if a function returns them.
    const auto load = [](const TYPE* p) { return *(const values*)p; };
    const int height = image.shape[0], step = image.shape[2], columns = image.shape[1] * step;
    const int reach = radius_y * spacing, size = 2 * reach + 1, pitch = lines.shape[1];
    const int margin = radius_x * spacing * step;
    TYPE* const window = lines.data + (size_t)slab * size * pitch + margin;
    for (int y = first; y < last; ++y) {
        for (int v = y == first ? y - reach : y + reach; v <= y + reach; ++v) {
            const int inside = v < 0 ? 0 : v < height ? v : height - 1;
            const TYPE* from = image.data + (size_t)inside * columns;
            TYPE* to = window + (size_t)((v + size * height) % size) * pitch;
            for (int i = 0; i < margin; ++i) {
                to[i - margin] = from[i % step];
                to[columns + i] = from[columns - step + i % step];
            }
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < columns; ++i) to[i] = from[i];
        }
        unsigned long long* out = (unsigned long long*)bits.data + (size_t)y * columns;
        for (int begin = 0; begin < columns; begin += 64) {
            unsigned char bytes[8][64] = {};
            octets some = {};
            const TYPE* centre = window + (size_t)(y % size) * pitch + begin;
            int n = 0;
            for (int dy = -radius_y; dy <= (symmetric ? 0 : radius_y); ++dy) {
                const int v = dy * spacing;
                const TYPE* const above = window + (size_t)((y + v + size) % size) * pitch + begin;
                const TYPE* const below = window + (size_t)((y - v + size) % size) * pitch + begin;
                for (int dx = -radius_x; dx <= radius_x; ++dx) {
                    if (dy == 0 && (symmetric ? dx >= 0 : dx == 0)) continue;
                    const int u = dx * spacing * step;
                    const TYPE *const a = above + u, *const b = symmetric ? below - u : centre;
                    const auto darker = __builtin_convertvector(load(a) < load(b), octets);
                    some |= darker & (unsigned char)(1 << n % 8);
                    __builtin_memcpy(bytes[n / 8], &some, 64);
                    if (++n % 8 == 0) some = (octets){};
                }
            }
            unsigned long long words[64];
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) words[k] = bytes[0][k];
            for (int i = 1; 8 * i < n; ++i) {
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < 64; ++k) words[k] |= (unsigned long long)bytes[i][k] << (8 * i);
            }
            const int number = columns - begin < 64 ? columns - begin : 64;
            __builtin_memcpy(out + begin, words, number * sizeof *words);
        }
    }
}
