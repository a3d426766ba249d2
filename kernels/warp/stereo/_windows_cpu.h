#include "costs/_sums_cpu.h"
#include "_turned_cpu.h"

void match_windows(int slab, int first, int last, wp::array_t<ELEMENT> left,
                   wp::array_t<ELEMENT> right, int count, Windows windows, WinnerRule rule,
                   WindowWork work, WinnerArrays winners, wp::array_t<int> right_index) {
    typedef WindowRow::sums sums;
    const int width = left.shape[1], start = windows.first, radius_x = windows.radius_x;
    const WindowRow row = {(const ELEMENT*)left.data,
                           (const ELEMENT*)right.data,
                           left.shape[0],
                           width,
                           left.shape[2],
                           windows.octets,
                           start,
                           count,
                           windows.radius_y,
                           radius_x,
                           work.lines.data + (size_t)slab * work.lines.shape[1],
                           work.columns.data + (size_t)slab * work.columns.shape[1]};
    const sums none = (SUM)Turned::NONE - (sums){};
    const int edge = LANES, turned_width = (width + TILE - 1) / TILE * TILE, line = work.line;
    SUM* const tile = work.turned.data + (size_t)slab * work.turned.shape[1];
    const Turned turned = {tile + TILE * LANES + edge, line, count};
    for (int k = 0; k < row.range(); ++k)
        for (int i = -edge; i < line - edge; ++i)
            if (i < 0 || i >= turned_width) turned.lines[(size_t)k * line + i] = Turned::NONE;
    const auto keep = [&](const sums& total, int x, int chunk) __attribute__((always_inline)) {
        const int at = x - 2 * radius_x, row = at % TILE;
        *(sums*)(tile + row * LANES) = total;
        if (row == TILE - 1 || at == width - 1) {
            for (int i = row + 1; i < TILE; ++i) *(sums*)(tile + i * LANES) = none;
            for (int begin = 0; begin < LANES; begin += TILE)
                turned.turn(tile + begin, LANES, chunk + begin, at - row);
        }
    };
    for (int y = first; y < last; ++y) {
        sum_windows(row, y, y == first, keep);
        for (int begin = 0; begin < width; begin += LANES) {
            const int number = width - begin < LANES ? width - begin : LANES;
            const size_t p = (size_t)y * width + begin;
            store_winners(turned, begin, number, rule, winners, p);
            SUM least[LANES], place[LANES];
            turned.least_of_right(begin + start, width, *(sums*)least, *(sums*)place);
            int* const to = right_index.data + p;
            for (int i = 0; i < number; ++i) to[i] = least[i] == Turned::NONE ? -1 : place[i];
        }
    }
}
