// needs POINTS LANES
// The rows of a slab are angles. Points are sorted by the codes of their directions; those of code c
// begin at begins[c], and the codes that vote for an angle form a ring. A slab keeps the votes of
// the angles around one, a line each, between margins of 0. A key is a peak's votes, subtracted
// from the largest integer, then its bin and angle.
void find_peaks(int slab, int first, int last, Voters voters, int shift, wp::vec4i limits,
                wp::array_t<int> lines, wp::array_t<wp::int64> keys, wp::array_t<int> counts) {
    const int bins = limits[0], threshold = limits[1], min_distance = limits[2];
    const int min_angle = limits[3];
    const int *codes = voters.codes.data, *begins = voters.begins.data;
    const long long* pairs = (const long long*)voters.points.data;  // the row is the lower half
    const int angles = voters.codes.shape[0], every = voters.begins.shape[0] - 2,
              pitch = lines.shape[1];
    const int rows = 2 * min_angle + 1, start = first - min_angle;
    int* ring = lines.data + (size_t)slab * rows * pitch + min_distance;
    const auto line = [&](int angle) { return ring + (size_t)((angle - start) % rows) * pitch; };
    // After half a turn, rho changes its sign.
    const auto turns = [&](int angle) { return (angle < 0) - (angle >= angles); };
    const auto cast = [&](int angle, int* votes) {
        const long long c = voters.cosine.data[angle], s = voters.sine.data[angle],
                        o = voters.offset.data[angle];
        const auto add = [&](int begin, int count) __attribute__((always_inline)) {
            int at[POINTS];
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const long long pair = pairs[begin + i];
                at[i] = (unsigned long long)((pair >> 32) * c + (int)pair * s + o) >> shift;
            }
            for (int i = 0; i < count; ++i) ++votes[at[i]];
        };
        const int from = codes[2 * angle], to = codes[2 * angle + 1];
        for (int part = 0; part <= (from >= to); ++part) {
            const int end = begins[part || from < to ? to : every];
            int i = part ? 0 : begins[from];
            for (; i + POINTS <= end; i += POINTS) add(i, POINTS);
            add(i, end - i);
        }
    };
    // Tell whether no value in the window is larger, and no equal value precedes.
    const auto is_maximum = [&](int bin, int angle) {
        const int here = line(angle)[bin], *votes = line(angle - min_angle);
        for (int t = angle - min_angle; t <= angle + min_angle; ++t) {
            for (int r = bin - min_distance; r <= bin + min_distance; ++r) {
                const int there = votes[r];
                if (there < here) continue;
                const int turn = turns(t), row = turn ? bins - 1 - r : r;
                const bool before = row < bin || (row == bin && t + turn * angles < angle);
                if (there > here || before) return false;
            }
            votes = votes == ring + (size_t)(rows - 1) * pitch ? ring : votes + pitch;
        }
        return true;
    };
    wp::int64* kept = keys.data + (size_t)slab * keys.shape[1];
    for (int ahead = start; ahead < last + min_angle; ++ahead) {
        const int turn = turns(ahead), angle = ahead - min_angle;
        int* votes = line(ahead);
        for (int r = -min_distance; r < pitch - min_distance; ++r) votes[r] = 0;
        if (turns(ahead + turn * angles) == 0) cast(ahead + turn * angles, votes);
        for (int r = 0; turn && r < bins / 2; ++r) {
            const int other = votes[r];
            votes[r] = votes[bins - 1 - r];
            votes[bins - 1 - r] = other;
        }
        if (angle < first) continue;
        const int *here = line(angle), *left = line(angle - 1), *right = line(angle + 1);
        for (int begin = 0; begin < bins; begin += LANES) {
            int some = 0;
            for (int r = begin; r < begin + LANES; ++r) some |= here[r] > threshold;
            if (!some) continue;
            unsigned char found[LANES];
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const int r = begin + k, v = here[r];
                found[k] = (v > threshold) & (v >= here[r - 1]) & (v >= here[r + 1]) &
                           (v >= left[r]) & (v >= right[r]) & (v >= left[r - 1]) &
                           (v >= left[r + 1]) & (v >= right[r - 1]) & (v >= right[r + 1]);
            }
            for (int k = 0; k < LANES; k += 8) {
                unsigned long long eight;
                __builtin_memcpy(&eight, found + k, 8);
                for (; eight; eight &= eight - 1) {
                    const int bin = begin + k + __builtin_ctzll(eight) / 8;
                    if (is_maximum(bin, angle))
                        *kept++ = ((long long)(0x7fffffff - here[bin]) << 32) +
                                  (long long)bin * angles + angle;
                }
            }
        }
    }
    counts.data[slab] = kept - (keys.data + (size_t)slab * keys.shape[1]);
}
