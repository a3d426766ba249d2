// needs ANGLES GROUP POINTS WEIGHTED
// The first of several starts is that of the image; a list that is no mask has only its end.
// The rows of a slab are groups of ANGLES angles. Vector code computes the bins of POINTS points
// for ANGLES angles at a time, because successive votes of one angle often fall into the same bin
// and would wait for each other. Histograms of GROUP angles are written together, one cache line
// per bin.
void vote(int slab, int first, int last, wp::array_t<int> points, wp::array_t<int> starts,
          wp::array_t<int> cosine, wp::array_t<int> sine, wp::array_t<wp::int64> offset, int shift,
          wp::array_t<int> weights, wp::array_t<int> lines, wp::array_t<int> votes) {
    const long long* pairs = (const long long*)points.data;  // the row is the lower half
    const int origin = starts.shape[0] > 1 ? starts.data[0] : 0;
    const int number = starts.data[starts.shape[0] - 1], angles = votes.shape[1];
    const size_t pitch = lines.shape[1];
    int* histograms = lines.data + (size_t)slab * GROUP * pitch;
    const auto add = [&](int* h, int angle, int begin, int count) __attribute__((always_inline)) {
        int at[ANGLES][POINTS];
        for (int k = 0; k < ANGLES; ++k) {
            const long long c = cosine.data[angle + k], s = sine.data[angle + k];
            const long long o = offset.data[angle + k];
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const long long pair = pairs[begin + i];
                at[k][i] = (unsigned long long)((pair >> 32) * c + (int)pair * s + o) >> shift;
            }
        }
        for (int i = 0; i < count; ++i) {
            const int vote = WEIGHTED ? weights.data[begin + i] : 1;
#pragma clang loop unroll(full)
            for (int k = 0; k < ANGLES; ++k) h[k * pitch + at[k][i]] += vote;
        }
    };
    for (int angle = first * ANGLES; angle < last * ANGLES; angle += GROUP) {
        const int rest = last * ANGLES - angle, count = rest < GROUP ? rest : GROUP;
        for (size_t i = 0; i < count * pitch; ++i) histograms[i] = 0;
        for (int k = 0; k < count; k += ANGLES) {
            int* h = histograms + k * pitch;
            int begin = origin;
            for (; begin + POINTS <= number; begin += POINTS) add(h, angle + k, begin, POINTS);
            add(h, angle + k, begin, number - begin);
        }
        const int written = angles - angle < count ? angles - angle : count;
        for (size_t bin = 0; bin < pitch; ++bin) {
            int* to = votes.data + bin * angles + angle;
            for (int k = 0; k < written; ++k) to[k] = histograms[k * pitch + bin];
        }
    }
}

// needs WEIGHTED
// The rows of a slab are angles. A point has few votes, so each is added directly to its bin.
void vote_directed(int slab, int first, int last, wp::array_t<int> points, wp::array_t<int> starts,
                   wp::array_t<int> windows, wp::array_t<int> cosine, wp::array_t<int> sine,
                   wp::array_t<wp::int64> offset, int shift, wp::array_t<int> weights,
                   wp::array_t<int> votes) {
    const int origin = starts.shape[0] > 1 ? starts.data[0] : 0;
    const int number = starts.data[starts.shape[0] - 1];
    const size_t angles = votes.shape[1];
    for (size_t bin = 0; bin < votes.shape[0]; ++bin)
        for (int angle = first; angle < last; ++angle) votes.data[bin * angles + angle] = 0;
    for (int i = origin; i < number; ++i) {
        const int begin = windows.data[2 * i], end = begin + windows.data[2 * i + 1];
        const long long y = points.data[2 * i], x = points.data[2 * i + 1];
        const int vote = WEIGHTED ? weights.data[i] : 1;
        for (int turn = 0; turn <= (end > angles); ++turn) {  // the window may continue at angle 0
            const int base = turn * (int)angles;
            const int from = begin - base > first ? begin - base : first;
            const int to = end - base < last ? end - base : last;
            for (int angle = from; angle < to; ++angle) {
                const long long rho = x * cosine.data[angle] + y * sine.data[angle];
                votes.data[((rho + offset.data[angle]) >> shift) * angles + angle] += vote;
            }
        }
    }
}
