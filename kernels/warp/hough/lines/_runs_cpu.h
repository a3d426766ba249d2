// needs QUARTER LAST FARTHEST PLACES DIGIT
// Sort points by line, side of the line and place along it; then cut them at gaps, and list the
// runs that are long and dense. Digits of the places are sorted one after the other, the lines
// last. Points on no line come at the end, in their order.
void cut(int slab, int first, int last, wp::array_t<float> points, wp::array_t<int> codes,
         wp::array_t<int> labels, wp::array_t<wp::float64> lines, wp::array_t<int> normals,
         wp::vec3d limits, Sorting sorting, wp::array_t<wp::uint8> chosen, wp::array_t<int> total) {
#pragma clang fp contract(off)
    const int number = points.shape[0], count = lines.shape[1];
    const double *cosine = lines.data, *sine = cosine + count;
    const double max_gap = limits[0], least = limits[1], density = limits[2];
    double* along = sorting.along.data;
    int *group = sorting.groups.data, *order = sorting.order.data, *off = order + number;
    // A pair is a place along the line and a point.
    typedef unsigned long long Pair;
    Pair *from = (Pair*)sorting.pairs.data, *to = from + number;
    int on_lines = 0, others = 0;
    for (int i = 0; i < number; ++i) {  // avoid a branch, which could not be predicted
        const bool on = labels.data[i] < count;
        chosen.data[i] = 0;
        order[on_lines] = off[others] = i;
        on_lines += on;
        others += !on;
    }
    unsigned nearest = ~0u, farthest = 0;
    for (int j = 0; j < on_lines; ++j) {
        const int i = order[j], label = labels.data[i];
        const double y = points.data[2 * i], x = points.data[2 * i + 1];
        const double at = y * cosine[label] - x * sine[label];
        // A gradient is along the normal, or against it.
        const int turn = (codes.data[i] - normals.data[label] + QUARTER) & LAST;
        group[i] = 2 * label + (turn < 2 * QUARTER);
        along[i] = at;
        const unsigned step = __builtin_floor((at + FARTHEST) * PLACES + 0.5);
        nearest = step < nearest ? step : nearest;
        farthest = step > farthest ? step : farthest;
        from[j] = (Pair)step << 32 | i;
    }
    const auto sort = [&](int size, const auto& digit, const auto& put) {
        int* begin = sorting.counts.data;
        for (int k = 0; k < size; ++k) begin[k] = 0;
        for (int j = 0; j < on_lines; ++j) ++begin[digit(from[j])];
        for (int k = 0, before = 0; k < size; ++k) {
            const int here = begin[k];
            begin[k] = before;
            before += here;
        }
        for (int j = 0; j < on_lines; ++j) put(begin[digit(from[j])]++, from[j]);
    };
    for (int shift = 0; shift < 32 && (farthest - nearest) >> shift; shift += DIGIT) {
        sort(
            1 << DIGIT,
            [&](Pair p) { return ((unsigned)(p >> 32) - nearest) >> shift & ((1 << DIGIT) - 1); },
            [&](int place, Pair p) { to[place] = p; });
        Pair* const sorted = to;
        to = from;
        from = sorted;
    }
    sort(
        2 * count, [&](Pair p) { return group[(int)p]; },
        [&](int place, Pair p) { order[place] = (int)p; });
    for (int i = 0; i < others; ++i) order[on_lines + i] = off[i];
    int kept = 0;
    for (int begin = 0, end; begin < on_lines; begin = end) {
        const int of = group[order[begin]];
        const double start = along[order[begin]];
        double stop = start;
        for (end = begin + 1; end < on_lines && group[order[end]] == of; ++end) {
            const double next = along[order[end]];
            if (next - stop > max_gap) break;
            stop = next;
        }
        const double length = stop - start;
        if (!(length >= least && (double)(end - begin) >= density * length)) continue;
        for (int j = begin; j < end; ++j) chosen.data[order[j]] = 1;
        sorting.runs.data[2 * kept] = begin;
        sorting.runs.data[2 * kept + 1] = end - begin;
        ++kept;
    }
    total.data[0] = kept;
}
