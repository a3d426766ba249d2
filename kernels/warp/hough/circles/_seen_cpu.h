// The edge points that may belong to a circle: their distance from the centre is in [least, most],
// and their line passes near the centre. They are tested 64 at a time, as vector code.
struct Seen {
    const float *row, *column, *down, *along;  // positions of the points, and their directions
    float cy, cx, least, most, slack, slope;
    bool forward, backward;   // whether a centre may be along a point's gradient, or against it
    int begin, stop, number;  // the points that `next` has tested, and the end of all points
    unsigned char seen[64];   // whether each tested point counts
    float far[64];            // its distance from the centre

    // Points are in the order of their pixels, so their rows ascend, except by half a pixel.
    Seen(const float* lines, int count, float cy, float cx, float least, float most, float slack,
         float slope, int first_side, int last_side)
        : row(lines),
          column(lines + count),
          down(lines + 2 * count),
          along(lines + 3 * count),
          cy(cy),
          cx(cx),
          least(least),
          most(most),
          slack(slack),
          slope(slope),
          forward(first_side > 0),
          backward(last_side < 0),
          begin(before(cy - most - 1.0f, count)),
          stop(before(cy + most + 1.0f, count)),
          number(0) {}

    int before(float y, int count) const {
        int low = 0, high = count;
        while (low < high) {
            const int middle = (low + high) / 2;
            if (row[middle] < y)
                low = middle + 1;
            else
                high = middle;
        }
        return low;
    }

    // Test points until some of them count; tell whether there are any.
    bool next() {
        for (begin += number; begin < stop; begin += number) {
            number = stop - begin < 64 ? stop - begin : 64;
            if (test()) return true;
        }
        return false;
    }

    bool test() {
#pragma clang fp contract(off)
        const int n = number;
        const float *y = row + begin, *x = column + begin;
        const float *sine = down + begin, *cosine = along + begin;
        const float oy = cy, ox = cx, low = least, high = most, beside = slack, rise = slope;
        const bool one = forward, other = backward;
        unsigned char* found = seen;
        float* distance = far;
        int some = 0;
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < n; ++k) {
            const float dy = y[k] - oy, dx = x[k] - ox;
            const float d = wp::sqrt(dy * dy + dx * dx);
            const float aside = dy * cosine[k] - dx * sine[k];
            const float ahead = dy * sine[k] + dx * cosine[k];
            const bool turned = ((ahead < 0.0f) & one) | ((ahead > 0.0f) & other);
            const bool near = (d >= low) & (d <= high);
            found[k] = near & turned & (__builtin_fabsf(aside) <= beside + rise * d);
            distance[k] = d;
            some |= found[k];
        }
        return some;
    }
};
