#pragma once

// A match as its rows x0, y0, x1, y1, and z0 of a scene, and the key that it is sorted by;
// taichi/geometry/matches.py has the rules.
struct Match {
    typedef unsigned long long Key;
    enum { INDEX_BITS = 18, MOST = 5 };
    double value[MOST];
    int rows;

    Match(const wp::array_t<double>& points0, const wp::array_t<double>& points1, size_t i) {
        const int columns = points0.shape[1];
        const double *p = points0.data + i * columns, *q = points1.data + 2 * i;
        rows = columns + 2;
        value[0] = columns == 3 ? p[0] : p[1], value[1] = columns == 3 ? p[1] : p[0];
        value[2] = q[1], value[3] = q[0], value[4] = columns == 3 ? p[2] : 0.0;
        for (int r = 0; r < MOST; ++r) value[r] = value[r] == 0.0 ? 0.0 : value[r];  // one zero
    }

    bool finite() const {
        bool all = true;
        for (int r = 0; r < rows; ++r) all = all && value[r] - value[r] == 0.0;
        return all;
    }

    bool operator!=(const Match& other) const {
        bool differs = false;
        for (int r = 0; r < rows; ++r) differs = differs || value[r] != other.value[r];
        return differs;
    }

    static int index(Key key) { return (int)(key & ((1 << INDEX_BITS) - 1)); }

    static bool alike(Key one, Key other) { return one >> INDEX_BITS == other >> INDEX_BITS; }

    // A hash of 46 bits, mixed as by splitmix64, and the index of the match.
    Key key(int index) const {
        Key hash = 0;
        for (int r = 0; r < rows; ++r) {
            union {
                double number;
                Key bits;
            } both = {value[r]};
            hash = (hash ^ both.bits) * 0x9E3779B97F4A7C15ull;
            hash ^= hash >> 29;
        }
        return (hash >> INDEX_BITS << INDEX_BITS) | (Key)index;
    }
};
