#include "_costs_cpu.h"
#include "_steps_cpu.h"
#include "../_turned_cpu.h"

void sweep(int slab, int first_slab, int last_slab, Pair pair, int count, Course course,
           WinnerRule rule, Work work, wp::array_t<wp::uint16> turned, wp::array_t<TOTAL> sums,
           BestRight right, WinnerArrays winners) {
    typedef NUMBER numbers __attribute__((vector_size(SPAN * sizeof(NUMBER)), aligned(1)));
    typedef NUMBER few __attribute__((vector_size(LANES * sizeof(NUMBER)), aligned(1)));
    typedef TOTAL part __attribute__((vector_size(LANES * sizeof(TOTAL)), aligned(1)));
    const int height = pair.gray.shape[0], columns = pair.gray.shape[1];
    const int padded = work.costs.shape[1] / BLOCK, length = pair.unfolded.shape[1];
    const Steps steps = {pair.gray.data,  course.near,         course.far.data,
                         work.slots.data, work.slots.shape[1], padded};
    NUMBER* const costs = work.costs.data + (size_t)slab * work.costs.shape[1];
    TOTAL* const totals = work.totals.data + (size_t)slab * work.totals.shape[1];
    // The sums of a row of a task, pixel by pixel, and transposed.
    unsigned short* const tile = turned.data + (size_t)slab * turned.shape[1];
    const Turned lines = {tile + TILE * padded + LANES, TILE + 2 * LANES, count};
    for (int n = 0; n < padded * lines.pitch; ++n) tile[TILE * padded + n] = Turned::NONE;
    numbers rising;
    for (int n = 0; n < SPAN; ++n) rising[n] = n;
    Sweep sweep = {{course.tasks.data, course.strips, course.blocks},
                   height,
                   columns,
                   course.step,
                   course.top,
                   winners.index.shape[0],
                   Sweep::BEGIN};
    while (sweep.next()) {
        // Store the costs of a pixel; meanwhile, prefetch its sums, if there are any, and the memory
        // of its results, because a store that waits for memory holds up all later ones.
        const int y = sweep.y();
        const unsigned char* const lines_of_right =
            pair.unfolded.data + (size_t)y * LINES * length + columns - 1;
        const auto put = [&](int j) __attribute__((always_inline)) {
            const int x = sweep.x(j);
            const size_t p = (size_t)y * columns + x;
            const auto cost = MatchCost::of_pixel(pair.bits.data[p], pair.gray.data[p],
                                                  lines_of_right - x, length);
            if (course.add && sweep.row >= 0) {
                const TOTAL* soon = sums.data + ((size_t)sweep.row * columns + x) * padded;
                for (int d = 0; d < padded; d += 64 / sizeof(TOTAL)) __builtin_prefetch(soon + d);
            }
            __builtin_prefetch(pair.bits.data + p + (long long)sweep.step * columns);
            if (course.last && sweep.row >= 0 && j % 16 == 0) {
                const size_t q = (size_t)sweep.row * columns + x;
                __builtin_prefetch(winners.index.data + q, 1);
                __builtin_prefetch(winners.disparity.data + q, 1);
                __builtin_prefetch(winners.cost.data + q, 1);
                __builtin_prefetch(winners.confidence.data + q, 1);
            }
            NUMBER* to = costs + (j - sweep.begin) * padded;
            for (int d = 0; d < count; d += SPAN) {
                const auto some = __builtin_convertvector(cost.at(d), numbers);
                const NUMBER left = count - d < SPAN ? count - d : SPAN;
                *(numbers*)(to + d) = rising < left ? some : LARGEST - (numbers){};
            }
        };
        // The first sweep comes from the left, so its totals are a piece of the sums.
        const bool whole = !course.add && sweep.row >= 0;
        const size_t begin = (size_t)sweep.row * columns + sweep.begin;
        advance(steps, sweep, costs, whole ? sums.data + begin * padded : totals, put);
        if (whole || sweep.row < 0) continue;
        if (!course.last) {
            Steps::collect(sweep, totals, padded, course.add, sums.data, padded);
            continue;
        }
        // The sums of these pixels, from left to right.
        const int number = sweep.end - sweep.begin, base = sweep.x(sweep.end - 1);
        for (int i = 0; i < TILE; ++i) {
            unsigned short* const to = tile + i * padded;
            if (i >= number) {
                for (int d = 0; d < padded; ++d) to[d] = Turned::NONE;
                continue;
            }
            const size_t here = (size_t)(number - 1 - i) * padded;
            const TOTAL* const others =
                sums.data + ((size_t)sweep.row * columns + base + i) * padded;
            for (int d = 0; d < padded; d += LANES) {
                auto sum =
                    __builtin_convertvector(*(const part*)(totals + here + d), Turned::sums) +
                    __builtin_convertvector(*(const part*)(others + d), Turned::sums);
                // The costs of both sweeps.
                if (CHANGES)
                    sum += __builtin_convertvector(*(const few*)(costs + here + d), Turned::sums) *
                           (unsigned short)(2 * PATHS);
                *(Turned::sums*)(to + d) = sum;
            }
        }
        for (int d = 0; d < padded; d += TILE) lines.turn(tile + d, padded, d, 0);
        store_winners(lines, 0, number, rule, winners, (size_t)sweep.row * columns + base);
        // The best matches so far of the row of the right image. Blocks come from right to left, so
        // indices decrease, and a tie replaces the match.
        unsigned short* const cost = right.cost.data + (size_t)sweep.row * right.cost.shape[1];
        unsigned short* const place = right.place.data + (size_t)sweep.row * right.cost.shape[1];
        if (sweep.begin == 0)
            for (int x = 0; x < columns; ++x) cost[x] = Turned::NONE;
        const int after = base + number - rule.first, lowest = base - rule.first - count + 1;
        for (int x = lowest > 0 ? lowest : 0; x < after && x < columns; x += LANES) {
            Turned::sums least, index, &old = *(Turned::sums*)(cost + x);
            lines.least_of_right(x + rule.first - base, number, least, index);
            Turned::sums& at = *(Turned::sums*)(place + x);
            at = least <= old ? index : at;
            old = __builtin_elementwise_min(least, old);
        }
        if (sweep.end < columns) continue;
        int* const to = right.index.data + (size_t)sweep.row * columns;
        for (int x = 0; x < columns; ++x) to[x] = cost[x] == Turned::NONE ? -1 : place[x];
    }
}
