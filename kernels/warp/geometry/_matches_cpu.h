#include "_matches.h"

// needs BUCKET_BITS
// Sort the finite matches of a pair by their keys, equal ones once: first into buckets by their
// leading bits, then by Shell's method within each. List them, their places and their box.
void sort_pair(int pair, wp::array_t<double> points0, wp::array_t<double> points1,
               wp::array_t<int> spans, wp::array_t<wp::uint64> keys, wp::array_t<int> order,
               wp::array_t<int> places, wp::array_t<int> counts, wp::array_t<double> boxes) {
    enum { BUCKETS = 1 << BUCKET_BITS };
    const int *const span = spans.data + 3 * (size_t)pair, first = span[0], count = span[1];
    Match::Key* const sorted = (Match::Key*)keys.data + 2 * (size_t)first;
    Match::Key* const mixed = sorted + count;
    int heads[BUCKETS + 1] = {0};
    const auto bucket = [](Match::Key key) { return (int)(key >> (64 - BUCKET_BITS)); };
    int kept = 0;
    for (int i = 0; i < count; ++i) {
        const Match match(points0, points1, first + i);
        places.data[first + i] = -1;
        if (!match.finite()) continue;
        mixed[kept] = match.key(i);
        ++heads[bucket(mixed[kept++]) + 1];
    }
    for (int b = 0; b < BUCKETS; ++b) heads[b + 1] += heads[b];
    for (int i = 0; i < kept; ++i) sorted[heads[bucket(mixed[i])]++] = mixed[i];
    for (int b = 0, begin = 0; b < BUCKETS; begin = heads[b++]) {
        int gap = 1;
        while (gap < (heads[b] - begin) / 3) gap = 3 * gap + 1;
        for (; gap > 0; gap /= 3)
            for (int i = begin + gap; i < heads[b]; ++i) {
                const Match::Key key = sorted[i];
                int j = i;
                for (; j >= begin + gap && sorted[j - gap] > key; j -= gap)
                    sorted[j] = sorted[j - gap];
                sorted[j] = key;
            }
    }
    const int rows = points0.shape[1] + 2;
    double* const box = boxes.data + 2 * (size_t)rows * pair;
    for (int r = 0; r < 2 * rows; ++r) box[r] = 0.0;
    int number = 0;
    for (int k = 0; k < kept; ++k) {
        const int i = Match::index(sorted[k]);
        const Match match(points0, points1, first + i);
        if (k == 0 || !Match::alike(sorted[k], sorted[k - 1]) ||
            match != Match(points0, points1, first + Match::index(sorted[k - 1]))) {
            order.data[first + number++] = i;
            for (int r = 0; r < rows; ++r) {
                const double v = match.value[r];
                box[r] = k == 0 || v < box[r] ? v : box[r];
                box[rows + r] = k == 0 || v > box[rows + r] ? v : box[rows + r];
            }
        }
        places.data[first + i] = span[2] + number - 1;
    }
    counts.data[pair] = number;
}

// Scale the matches of a pair, in their order; there are zeros up to the next pair.
void scale_pair(int pair, wp::array_t<double> points0, wp::array_t<double> points1,
                wp::array_t<int> spans, wp::array_t<int> order, wp::array_t<int> counts,
                wp::array_t<double> scales, int lanes, wp::array_t<float> matches) {
    const int* const span = spans.data + 3 * (size_t)pair;
    const int rows = matches.shape[0], room = (span[1] + lanes - 1) / lanes * lanes;
    const double *const scale = scales.data + 2 * (size_t)rows * pair, *const shift = scale + rows;
    for (int k = 0; k < room; ++k) {
        float* const to = matches.data + span[2] + k;
        const size_t pitch = matches.shape[1];
        if (k < counts.data[pair]) {
            const Match match(points0, points1, span[0] + order.data[span[0] + k]);
            for (int r = 0; r < rows; ++r)
                to[r * pitch] = (float)(match.value[r] * scale[r] - shift[r]);
        } else {
            for (int r = 0; r < rows; ++r) to[r * pitch] = 0.0f;
        }
    }
}
