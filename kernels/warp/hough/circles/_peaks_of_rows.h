#include "_peaks.h"

// Count the peaks of a row.
void count_in_row(wp::array_t<float> votes, int row, wp::array_t<float> limits, int down, int along,
                  wp::array_t<int> counts) {
    const int width = votes.shape[2], height = votes.shape[1], plane = row / height;
    Peaks peaks = {votes.data + (size_t)row * width,
                   row - plane * height,
                   height,
                   width,
                   down,
                   along,
                   limits.data[plane],
                   -64};
    int number = 0;
    while (peaks.next() < width) ++number;
    counts.data[row] = number;
}

// List plane, row, column and votes of the peaks of a row, beginning at its place in the list.
void gather_in_row(wp::array_t<float> votes, int row, wp::array_t<float> limits, int down,
                   int along, wp::array_t<int> starts, wp::array_t<int> places,
                   wp::array_t<float> values) {
    const int width = votes.shape[2], height = votes.shape[1], plane = row / height;
    Peaks peaks = {votes.data + (size_t)row * width,
                   row - plane * height,
                   height,
                   width,
                   down,
                   along,
                   limits.data[plane],
                   -64};
    for (int n = starts.data[row]; n < starts.data[row + 1]; ++n) {
        const int x = peaks.next();
        places.data[3 * n] = plane;
        places.data[3 * n + 1] = peaks.y;
        places.data[3 * n + 2] = x;
        values.data[n] = peaks.votes[x];
    }
}
