#include "_line_cpu.h"

// needs TYPE
// A cost that is NaN counts as infinite.
void pick(int slab, int first_row, int last_row, wp::array_t<TYPE> costs, WinnerRule rule,
          wp::array_t<COST> lines, WinnerArrays winners) {
    const int columns = costs.shape[1], depth = costs.shape[2], padded = lines.shape[1];
    COST* const line = lines.data + (size_t)slab * padded;
    COST most = (COST)MOST;  // stands for NaN as well
    for (int d = depth; d < padded; ++d) line[d] = most;
    const size_t end = (size_t)last_row * columns;
    for (size_t p = (size_t)first_row * columns; p < end; ++p) {
        const TYPE* from = costs.data + p * depth;
#pragma clang loop vectorize(assume_safety)
        for (int d = 0; d < depth; ++d) line[d] = from[d] < most ? from[d] : most;
        Line::winner(line, depth, padded)
            .store(rule.first, rule.subpixel, rule.uniqueness, winners.index.data + p,
                   winners.disparity.data + p, winners.cost.data + p, winners.confidence.data + p);
    }
}

// needs TYPE
void pick_right(int slab, int first_row, int last_row, wp::array_t<TYPE> costs, int first,
                wp::array_t<COST> lines, wp::array_t<COST> best, wp::array_t<PLACE> place,
                wp::array_t<int> index) {
    const int columns = costs.shape[1], depth = costs.shape[2], padded = lines.shape[1];
    COST* const line = lines.data + (size_t)slab * padded;
    COST most = (COST)MOST;  // stands for NaN as well
    for (int d = depth; d < padded; ++d) line[d] = most;
    const RightRow row = {best.data + (size_t)slab * best.shape[1],
                          place.data + (size_t)slab * best.shape[1], columns, padded};
    for (int y = first_row; y < last_row; ++y) {
        row.clear();
        for (int x = columns - 1; x >= 0; --x) {
            const TYPE* from = costs.data + ((size_t)y * columns + x) * depth;
#pragma clang loop vectorize(assume_safety)
            for (int d = 0; d < depth; ++d) line[d] = from[d] < most ? from[d] : most;
            row.take(line, x, first, depth);
        }
        row.read(depth, index.data + (size_t)y * columns);
    }
}
