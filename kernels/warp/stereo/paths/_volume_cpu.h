#include "_costs_cpu.h"

void match_costs(int slab, int first_row, int last_row, wp::array_t<wp::uint64> bits,
                 wp::array_t<wp::uint8> gray, wp::array_t<wp::uint8> unfolded,
                 wp::array_t<wp::uint8> costs) {
    const int columns = costs.shape[1], depth = costs.shape[2], length = unfolded.shape[1];
    for (int y = first_row; y < last_row; ++y)
        for (int x = 0; x < columns; ++x) {
            const size_t p = (size_t)y * columns + x;
            const unsigned char* right =
                unfolded.data + (size_t)y * LINES * length + columns - 1 - x;
            const auto cost = MatchCost::of_pixel(bits.data[p], gray.data[p], right, length);
            unsigned char* to = costs.data + p * depth;
            for (int d = 0; d < depth; d += SPAN) {
                const MatchCost::bytes some = cost.at(d);
                if (d + SPAN <= depth)
                    *(MatchCost::bytes*)(to + d) = some;
                else
                    for (int n = 0; n < depth - d; ++n) to[d + n] = some[n];
            }
        }
}
