#include "_steps_cpu.h"

// needs TYPE
void sweep(int slab, int first, int last, wp::array_t<TYPE> volume, wp::array_t<wp::uint8> guide,
           Course course, Work work, wp::array_t<wp::uint16> sums) {
    const int height = volume.shape[0], columns = volume.shape[1], depth = volume.shape[2];
    const int padded = work.costs.shape[1] / BLOCK;
    const bool adaptive = guide.shape[0] == height && guide.shape[1] == columns;
    const Steps steps = {adaptive ? guide.data : nullptr,
                         course.near,
                         course.far.data,
                         work.slots.data,
                         work.slots.shape[1],
                         padded};
    NUMBER* const costs = work.costs.data + (size_t)slab * work.costs.shape[1];
    TOTAL* const totals = work.totals.data + (size_t)slab * work.totals.shape[1];
    for (int j = 0; j < BLOCK; ++j)
        for (int d = depth; d < padded; ++d) costs[j * padded + d] = LARGEST;
    Sweep sweep = {{course.tasks.data, course.strips, course.blocks},
                   height,
                   columns,
                   course.step,
                   course.top,
                   sums.shape[0],
                   Sweep::BEGIN};
    while (sweep.next()) {
        // The costs of the row, as uint16. Meanwhile, prefetch the memory that is needed next: the
        // sums of these pixels, if there are any, and the costs of the next row.
        const auto put = [&](int j) __attribute__((always_inline)) {
            const int x = sweep.x(j);
            const TYPE* from = volume.data + ((size_t)sweep.y() * columns + x) * depth;
            if (course.add && sweep.row >= 0) {
                const unsigned short* soon = sums.data + ((size_t)sweep.row * columns + x) * depth;
                for (int d = 0; d < depth; d += 32) __builtin_prefetch(soon + d);
            }
            const TYPE* below = from + (long long)sweep.step * columns * depth;
            for (int d = 0; d < depth; d += 64 / sizeof(TYPE)) __builtin_prefetch(below + d);
            NUMBER* to = costs + (j - sweep.begin) * padded;
#pragma clang loop vectorize(assume_safety)
            for (int d = 0; d < depth; ++d) to[d] = from[d];
        };
        advance(steps, sweep, costs, totals, put);
        if (sweep.row >= 0) Steps::collect(sweep, totals, padded, course.add, sums.data, depth);
    }
}
