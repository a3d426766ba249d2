// needs SCALAR
// Mark the maxima of the rows of a slab. Of 64 values, few exceed the threshold, and few of those
// exceed the neighbours along both axes; only these are compared with the whole window.
void maxima_of_rows(int slab, int first, int last, wp::array_t<SCALAR> values, SCALAR threshold,
                    int min_distance, int min_angle, bool wraps, wp::array_t<wp::uint8> mask) {
    typedef SCALAR scalar;
    const int bins = values.shape[0], angles = values.shape[1];
    const scalar* votes = values.data;
    // Tell whether no value in the window is larger, and no equal value precedes.
    const auto is_maximum = [&](int bin, int angle) {
        const scalar here = votes[(size_t)bin * angles + angle];
        for (int dt = -min_angle; dt <= min_angle; ++dt) {
            int t = angle + dt, middle = bin;
            if (t < 0 || t >= angles) {
                if (!wraps) continue;
                t += t < 0 ? angles : -angles;
                middle = bins - 1 - bin;
                if (t < 0 || t >= angles) continue;
            }
            const int low = middle > min_distance ? middle - min_distance : 0;
            const int high = bins - middle > min_distance ? middle + min_distance + 1 : bins;
            for (int r = low; r < high; ++r) {
                const scalar there = votes[(size_t)r * angles + t];
                if (there > here) return false;
                if (there == here && (r < bin || (r == bin && t < angle))) return false;
            }
        }
        return true;
    };
    for (int bin = first; bin < last; ++bin) {
        const scalar* row = votes + (size_t)bin * angles;
        unsigned char* marks = mask.data + (size_t)bin * angles;
        const scalar* above = min_distance > 0 && bin > 0 ? row - angles : row;
        const scalar* below = min_distance > 0 && bin + 1 < bins ? row + angles : row;
        const int aside = min_angle > 0;
        for (int begin = 0; begin < angles; begin += 64) {
            const int size = angles - begin < 64 ? angles - begin : 64;
            unsigned char found[64];
            const auto prepare = [&](int from, int to) __attribute__((always_inline)) {
                int some = 0;
                for (int k = from; k < to; ++k) some |= row[begin + k] > threshold;
                return some;
            };
            const int some = size == 64 ? prepare(0, 64) : prepare(0, size);
            for (int k = 0; k < size; ++k) marks[begin + k] = 0;
            if (!some) continue;
            // The ends of a row have neighbours on one side only, or at the other end.
            const int from = begin > 0 ? 0 : aside;
            const int to = begin + size < angles ? size : size - aside;
            for (int k = 0; k < size; ++k) found[k] = row[begin + k] > threshold;
            for (int k = from; k < to; ++k) {
                const int x = begin + k;
                const scalar here = row[x];
                found[k] = (here > threshold) & (here >= row[x - aside]) &
                           (here >= row[x + aside]) & (here >= above[x]) & (here >= below[x]);
            }
            for (int k = 0; k < size; ++k)
                if (found[k]) marks[begin + k] = is_maximum(bin, begin + k);
        }
    }
}
