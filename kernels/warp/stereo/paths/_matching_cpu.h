#include "_costs_cpu.h"
#include "_steps_cpu.h"
#include "../_line_cpu.h"

void sweep(int slab, int first_slab, int last_slab, Pair pair, int count, Course course,
           WinnerRule rule, Work work, wp::array_t<wp::uint16> lines, wp::array_t<TOTAL> sums,
           BestRight right, WinnerArrays winners) {
    typedef NUMBER numbers __attribute__((vector_size(SPAN * sizeof(NUMBER)), aligned(1)));
    typedef NUMBER few __attribute__((vector_size(Line::WIDTH * sizeof(NUMBER)), aligned(1)));
    typedef TOTAL part __attribute__((vector_size(Line::WIDTH * sizeof(TOTAL)), aligned(1)));
    const int height = pair.gray.shape[0], columns = pair.gray.shape[1];
    const int padded = work.costs.shape[1] / BLOCK, length = pair.unfolded.shape[1];
    const Steps steps = {pair.gray.data,  course.near,         course.far.data,
                         work.slots.data, work.slots.shape[1], padded};
    NUMBER* const costs = work.costs.data + (size_t)slab * work.costs.shape[1];
    TOTAL* const totals = work.totals.data + (size_t)slab * work.totals.shape[1];
    unsigned short* const line = lines.data + (size_t)slab * padded;
    Sweep sweep = {{course.tasks.data, course.strips, course.blocks},
                   height,
                   columns,
                   course.step,
                   course.top,
                   winners.index.shape[0],
                   Sweep::BEGIN};
    while (sweep.next()) {
        // The costs of the row; meanwhile, prefetch its sums, if there are any.
        for (int j = sweep.begin; j < sweep.end; ++j) {
            const int x = sweep.x(j), y = sweep.y();
            const size_t p = (size_t)y * columns + x;
            const unsigned char* other =
                pair.unfolded.data + (size_t)y * LINES * length + columns - 1 - x;
            const auto cost =
                MatchCost::of_pixel(pair.bits.data[p], pair.gray.data[p], other, length);
            if (course.add && sweep.row >= 0) {
                const TOTAL* soon = sums.data + ((size_t)sweep.row * columns + x) * padded;
                for (int d = 0; d < padded; d += 64 / sizeof(TOTAL)) __builtin_prefetch(soon + d);
            }
            __builtin_prefetch(pair.bits.data + p + (long long)sweep.step * columns);
            NUMBER* to = costs + (j - sweep.begin) * padded;
            for (int d = 0; d < count; d += SPAN)
                *(numbers*)(to + d) = __builtin_convertvector(cost.at(d), numbers);
            for (int d = count; d < padded; ++d) to[d] = LARGEST;
        }
        // The first sweep comes from the left, so its totals are a piece of the sums.
        const bool whole = !course.add && sweep.row >= 0;
        const size_t begin = (size_t)sweep.row * columns + sweep.begin;
        steps.advance(sweep, costs, whole ? sums.data + begin * padded : totals);
        if (whole || sweep.row < 0) continue;
        if (!course.last) {
            Steps::collect(sweep, totals, padded, course.add, sums.data, padded);
            continue;
        }
        // The winners of these pixels, and of the right image.
        const RightRow best = {right.cost.data + (size_t)sweep.row * right.cost.shape[1],
                               right.place.data + (size_t)sweep.row * right.cost.shape[1], columns,
                               padded};
        for (int j = sweep.begin; j < sweep.end; ++j) {
            const int x = sweep.x(j);
            const size_t p = (size_t)sweep.row * columns + x;
            const size_t here = (size_t)(j - sweep.begin) * padded;
            for (int d = 0; d < padded; d += Line::WIDTH) {
                auto sum = __builtin_convertvector(*(const part*)(totals + here + d), Line::costs) +
                           __builtin_convertvector(*(const part*)(sums.data + p * padded + d),
                                                   Line::costs);
                // The costs of both sweeps.
                if (CHANGES)
                    sum += __builtin_convertvector(*(const few*)(costs + here + d), Line::costs) *
                           (unsigned short)(2 * PATHS);
                *(Line::costs*)(line + d) = sum;
            }
            for (int d = count; d < padded; ++d) line[d] = MOST;
            Line::winner(line, count, padded)
                .store(rule.first, rule.subpixel, rule.uniqueness, winners.index.data + p,
                       winners.disparity.data + p, winners.cost.data + p,
                       winners.confidence.data + p);
            best.take(line, x, rule.first, count);
        }
    }
}
