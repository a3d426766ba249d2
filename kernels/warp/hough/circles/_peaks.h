// The peaks of one row of votes, from left to right. A peak is above the limit. Within `down` rows
// and `along` columns of its plane, it is at least every vote, and above every vote that precedes
// it.
struct Peaks {
    const float* votes;  // the first vote of the row
    int y, height, width, down, along;
    float limit;
    int begin, count, next_one;  // first of 64 columns, number of columns, and the next to test
    unsigned char large[64];     // whether a column is a candidate

    // Few votes are as large as their four neighbours; only these are tested further.
    bool find_large() {
        const float *v = votes + begin, *above = y > 0 ? v - width : v;
        const float* below = y + 1 < height ? v + width : v;
        const float least = limit;
        const int n = count;
        unsigned char* out = large;
        int some = 0;
#pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < n; ++x)
            some |= out[x] = (v[x] > least) & (v[x] >= above[x]) & (v[x] >= below[x]);
        if (!some) return false;
        const int inner = begin + n < width ? n : n - 1;
#pragma clang loop vectorize(assume_safety)
        for (int x = begin ? 0 : 1; x < inner; ++x)
            out[x] &= (v[x] >= v[x - 1]) & (v[x] >= v[x + 1]);
        return true;
    }

    bool is_peak(int x) const {
        const int left = x - along < 0 ? 0 : x - along;
        const int right = x + along >= width ? width - 1 : x + along;
        const int top = y - down < 0 ? 0 : y - down;
        const int bottom = y + down >= height ? height - 1 : y + down;
        const float here = votes[x];
        for (int r = top; r <= bottom; ++r) {
            const float* u = votes + (long long)(r - y) * width;
            for (int c = left; c <= right; ++c) {
                const bool before = r < y || (r == y && c < x);
                if (u[c] > here || (u[c] == here && before)) return false;
            }
        }
        return true;
    }

    // The column of the next peak, or the width.
    int next() {
        for (;;) {
            for (; next_one < count; ++next_one)
                if (large[next_one] && is_peak(begin + next_one)) return begin + next_one++;
            begin += 64;
            if (begin >= width) return width;
            count = width - begin < 64 ? width - begin : 64;
            next_one = find_large() ? 0 : count;
        }
    }
};
