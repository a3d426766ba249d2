// A run is a connected part of a row; its label is its first pixel. Runs form trees within their
// region, and the root of a tree holds the size of the region.
struct Regions {
    const float* disparity;
    int columns;
    float difference;
    int *labels, *parents, *sizes;

    void find_runs(int row) const {
        const float* d = disparity;
        for (int i = row * columns, start = i, x = 0; x < columns; ++x, ++i) {
            if (x == 0 || !(__builtin_fabsf(d[i] - d[i - 1]) <= difference)) {
                start = i;
                parents[i] = i;
                sizes[i] = 0;
            }
            labels[i] = start;
            ++sizes[start];
        }
    }

    int top(int label) const {
        while (parents[label] != label) label = parents[label] = parents[parents[label]];
        return label;
    }

    // Join the runs of a row with those of the row above.
    void join_rows(int row) const {
        const float* d = disparity;
        int last = -1, last_above = -1;
        for (int i = row * columns; i < (row + 1) * columns; ++i) {
            const int up = i - columns;
            if (!(__builtin_fabsf(d[i] - d[up]) <= difference)) continue;
            if (labels[i] == last && labels[up] == last_above) continue;
            last = labels[i];
            last_above = labels[up];
            const int a = top(last), b = top(last_above);
            if (a == b) continue;
            const int root = a < b ? a : b, other = a < b ? b : a;
            parents[other] = root;
            sizes[root] += sizes[other];
        }
    }
};
