#include "_medians_network.h"

// needs SIDE
// Return the median of a window, row by row.
int middle_of(wp::vec_t<SIDE * SIDE, wp::int32> window) {
    PIXEL v[SIDE * SIDE];
    for (int u = 0; u < SIDE; ++u) {
        PIXEL column[SIDE];
        for (int t = 0; t < SIDE; ++t) column[t] = window[t * SIDE + u];
        Network::sort(column);
        for (int t = 0; t < SIDE; ++t) v[t * SIDE + u] = column[t];
    }
    return Network::median(v);
}

// needs SIDE
// Return the medians of four windows, which are the bytes of words: two at once, as halves.
unsigned middles_of(wp::vec_t<SIDE * SIDE, wp::uint32> window) {
    PIXEL found[2];
#pragma unroll
    for (int half = 0; half < 2; ++half) {
        PIXEL v[SIDE * SIDE];
#pragma unroll
        for (int u = 0; u < SIDE; ++u) {
            PIXEL column[SIDE];
#pragma unroll
            for (int t = 0; t < SIDE; ++t)
                column[t] = __byte_perm(window[t * SIDE + u], 0, half ? 0x4342 : 0x4140);
            Network::sort(column);
#pragma unroll
            for (int t = 0; t < SIDE; ++t) v[t * SIDE + u] = column[t];
        }
        found[half] = Network::median(v);
    }
    return __byte_perm(found[0], found[1], 0x6420);
}

// Return four bytes that begin at any place; the words around them are read as well.
unsigned four_at(wp::array_t<unsigned char> src, int plane, int row, int column) {
    const unsigned char* place =
        src.data + ((size_t)plane * src.shape[1] + row) * src.shape[2] + column;
    const unsigned turned = (size_t)place & 3;
    const unsigned* words = reinterpret_cast<const unsigned*>(place - turned);
    return __funnelshift_r(words[0], words[1], 8 * turned);
}
