// Means of the nearest samples of a colour, in integers, LANES pixels at once. Rows and columns
// beyond the image are those mirrored at its border.

#include "../_mirror.h"

// needs TYPE, SUM, LANES, FIRST_THIRD, SECOND_THIRD, LAST_THIRD, BOTH, TWICE
void average(int slab, int first, int last, wp::array_t<TYPE> raw, int red_row, int red_column,
             wp::array_t<TYPE> colours) {
    typedef TYPE samples
        __attribute__((vector_size(LANES * sizeof(TYPE)), aligned(sizeof(TYPE)), may_alias));
    typedef SUM sums __attribute__((vector_size(LANES * sizeof(SUM))));
    const int height = raw.shape[0], width = raw.shape[1];
    sums parity;
    for (int i = 0; i < LANES; ++i) parity[i] = i & 1;
    const auto read = [](const TYPE* p) {
        return __builtin_convertvector(*(const samples*)p, sums);
    };
    const auto narrow = [](const sums& v) { return __builtin_convertvector(v, samples); };
    for (int row = first; row < last; ++row) {
        const bool blue = (row & 1) != red_row;  // whether it is a row of blue and green
        const auto chroma = parity == (SUM)(blue ? 1 - red_column : red_column);
        const TYPE* rows[3];
        for (int k = 0; k < 3; ++k)
            rows[k] = raw.data + (size_t)Mirror::at(row + k - 1, height) * width;
        TYPE* out = colours.data + (size_t)row * width * 3;
        for (int begin = 0; begin < width; begin += LANES) {
            TYPE around[3][LANES + 2], found[3 * LANES];
            const TYPE* from[3];
            const bool inner = begin > 0 && begin + LANES < width;
            for (int k = 0; k < 3; ++k) {
                from[k] = inner ? rows[k] + begin : around[k] + 1;
                for (int i = 0; !inner && i < LANES + 2; ++i)
                    around[k][i] = rows[k][Mirror::at(begin + i - 1, width)];
            }
            const sums across = read(from[1] - 1) + read(from[1] + 1);
            const sums down = read(from[0]) + read(from[2]);
            const sums corners =
                (read(from[0] - 1) + read(from[0] + 1)) + (read(from[2] - 1) + read(from[2] + 1));
            const samples here = *(const samples*)from[1];
            const auto mine = __builtin_convertvector(chroma, samples) != 0;
            const samples own = mine ? here : narrow((across + 1) >> 1);
            const samples other = narrow(chroma ? (corners + 2) >> 2 : (down + 1) >> 1);
            const samples green = mine ? narrow((across + down + 2) >> 2) : here;
            const samples red = blue ? other : own, end = blue ? own : other;
            const auto two = __builtin_shufflevector(red, green, BOTH);
            const auto three = __builtin_shufflevector(end, end, TWICE);
            TYPE* to = inner ? out + 3 * (size_t)begin : found;
            *(samples*)to = __builtin_shufflevector(two, three, FIRST_THIRD);
            *(samples*)(to + LANES) = __builtin_shufflevector(two, three, SECOND_THIRD);
            *(samples*)(to + 2 * LANES) = __builtin_shufflevector(two, three, LAST_THIRD);
            const int rest = width - begin < LANES ? width - begin : LANES;
            for (int i = 0; !inner && i < 3 * rest; ++i) out[3 * (size_t)begin + i] = found[i];
        }
    }
}
