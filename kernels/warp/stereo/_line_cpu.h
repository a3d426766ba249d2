#include "_winner.h"

// The costs of one pixel on the CPU: a line in memory, padded with MOST to a multiple of 32.
//
// COST is unsigned short or float; PLACE is an unsigned integer of the same size; MOST is the
// largest COST.
// needs COST, PLACE, MOST
struct Line {
    typedef COST costs __attribute__((vector_size(64), aligned(4)));
    typedef PLACE places __attribute__((vector_size(64), aligned(4)));
    enum { WIDTH = 64 / sizeof(COST) };

    // The smaller value; if the first is NaN, the second.
    static costs lesser(costs a, costs b) { return a < b ? a : b; }

    static places rising() {
        places numbers;
        for (int n = 0; n < WIDTH; ++n) numbers[n] = n;
        return numbers;
    }

    static Winner winner(const COST* line, int depth, int padded) {
        const costs most = (costs){} + (COST)MOST;
        costs low = most, other = most;
        for (int d = 0; d < padded; d += WIDTH) low = lesser(*(const costs*)(line + d), low);
        const COST c = __builtin_reduce_min(low);
        places found = (places){} + (PLACE)padded;
        for (int d = 0; d < padded; d += WIDTH) {
            const places at = *(const costs*)(line + d) == c ? rising() + (PLACE)d : found;
            found = __builtin_elementwise_min(at, found);
        }
        int k = __builtin_reduce_min(found);
        k = k < depth ? k : 0;  // 0 if all costs are infinite
        for (int d = 0; d < padded; d += WIDTH) {
            const costs v = *(const costs*)(line + d);
            const costs apart = rising() + (PLACE)(d - k + 1) > (PLACE)2 ? v : most;
            other = lesser(apart, other);
        }
        const bool alone = k < 2 && k > depth - 3, inner = k > 0 && k < depth - 1;
        const WIDE before = inner ? (WIDE)line[k - 1] - (WIDE)c : (WIDE)0;
        const WIDE after = inner ? (WIDE)line[k + 1] - (WIDE)c : (WIDE)0;
        // The cost is read where it stands: 0 and -0 are equal, and the first is meant.
        return {k, (WIDE)line[k], (WIDE)__builtin_reduce_min(other), alone, inner, before, after};
    }
};

// The winners of a row of the right image, from the lines of the left one.
//
// Cost k of left pixel x belongs to right pixel x - first - k. A row keeps the best match of each
// right pixel, from the last column to the first, after a margin of `padded`, so that its index
// increases with k. Left pixels come from the last to the first, so k decreases, and a tie replaces
// the match.
struct RightRow {
    COST* best;
    PLACE* place;
    int columns, padded;

    void clear() const {
        for (int n = 0; n < columns + 2 * padded; ++n) best[n] = MOST;
        for (int n = 0; n < columns + 2 * padded; ++n) place[n] = padded;
    }

    void take(const COST* line, int x, int first, int depth) const {
        const int from = columns - 1 - x + first;
        if (from >= columns || from <= -depth) return;
        COST* b = best + padded + from;
        PLACE* p = place + padded + from;
        for (int d = 0; d < padded; d += Line::WIDTH) {
            const Line::costs v = *(const Line::costs*)(line + d),
                              old = *(const Line::costs*)(b + d);
            const Line::places before = *(const Line::places*)(p + d);
            *(Line::costs*)(b + d) = Line::lesser(v, old);
            *(Line::places*)(p + d) = v <= old ? Line::rising() + (PLACE)d : before;
        }
    }

    void read(int depth, int* index) const {
        for (int x = 0; x < columns; ++x) {
            const int k = place[padded + columns - 1 - x];
            index[x] = k < depth ? k : -1;
        }
    }
};
