// needs QUARTER LAST FARTHEST PLACES
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
    int *group = sorting.groups.data, *steps = group + number;
    int *one = sorting.order.data, *two = one + number;
    int on_lines = 0, off = 0;
    for (int i = 0; i < number; ++i) {
        const int label = labels.data[i];
        chosen.data[i] = 0;
        if (label >= count) {
            two[off++] = i;
            continue;
        }
        const double y = points.data[2 * i], x = points.data[2 * i + 1];
        const double at = y * cosine[label] - x * sine[label];
        // A gradient is along the normal, or against it.
        const int turn = (codes.data[i] - normals.data[label] + QUARTER) & LAST;
        group[i] = 2 * label + (turn < 2 * QUARTER);
        along[i] = at;
        steps[i] = (int)(unsigned int)__builtin_floor((at + FARTHEST) * PLACES + 0.5);
        one[on_lines++] = i;
    }
    // The second half of `order` is free again when these are at their place.
    for (int i = 0; i < off; ++i) one[on_lines + i] = two[i];
    const auto sort = [&](const int* from, int* to, int size, const auto& digit) {
        int* begin = sorting.counts.data;
        for (int k = 0; k < size; ++k) begin[k] = 0;
        for (int j = 0; j < on_lines; ++j) ++begin[digit(from[j])];
        for (int k = 0, before = 0; k < size; ++k) {
            const int here = begin[k];
            begin[k] = before;
            before += here;
        }
        for (int j = 0; j < on_lines; ++j) to[begin[digit(from[j])]++] = from[j];
    };
    sort(one, two, 2048, [&](int i) { return steps[i] & 2047; });
    sort(two, one, 2048, [&](int i) { return (steps[i] >> 11) & 2047; });
    sort(one, two, 1024, [&](int i) { return (int)((unsigned int)steps[i] >> 22); });
    sort(two, one, 2 * count, [&](int i) { return group[i]; });
    int kept = 0;
    for (int begin = 0, end; begin < on_lines; begin = end) {
        const int of = group[one[begin]];
        const double start = along[one[begin]];
        double stop = start;
        for (end = begin + 1; end < on_lines && group[one[end]] == of; ++end) {
            const double next = along[one[end]];
            if (next - stop > max_gap) break;
            stop = next;
        }
        const double length = stop - start;
        if (!(length >= least && (double)(end - begin) >= density * length)) continue;
        for (int j = begin; j < end; ++j) chosen.data[one[j]] = 1;
        sorting.runs.data[2 * kept] = begin;
        sorting.runs.data[2 * kept + 1] = end - begin;
        ++kept;
    }
    total.data[0] = kept;
}
