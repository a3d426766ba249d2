// The steps of Menon's demosaicing on extended planes: samples, R, B, G and the direction. R and B
// first hold green less own colour along rows and columns.

// needs PART, DIFFERENCES, GREEN, AT_GREEN, AT_CHROMA, REFINE_GREEN, REFINE_AT_CHROMA
void _menon(int row, int left, int right, int step, int red_row, int red_column, int margin,
            wp::array_t<float> planes) {
#pragma clang fp contract(off)
    const int y = row + margin, s = planes.shape[2];
    const size_t plane = (size_t)planes.shape[1] * s;
    const float third = 1.0f / 3.0f;
    const float* p = planes.data + (size_t)y * s;
    float *red = planes.data + plane + (size_t)y * s, *blue = red + plane;
    float *green = blue + plane, *direction = green + plane;
    const bool below = (y & 1) != red_row;  // whether it is a row of blue and green
    const int column = below ? 1 - red_column : red_column;
    float *own = below ? blue : red, *other = below ? red : blue;
    left += margin;
    right += margin;
    const auto either = [=](bool chosen, float yes, float no) { return chosen ? yes : no; };
    const auto size = [](float x) { return x < 0.0f ? -x : x; };
    const auto level = [=](const float* of, int x) { return 0.5f * (of[x - 1] + of[x + 1]); };
    const auto upright = [=](const float* of, int x) { return 0.5f * (of[x - s] + of[x + s]); };
    // All pixels are computed and those of the other kind left as they are, so that loops become
    // vector code. A step reads only pixels of the kind that it does not change, and its own.
    if (step == DIFFERENCES) {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const float c = p[x];
            const float h = level(p, x) + (0.5f * c - 0.25f * (p[x - 2] + p[x + 2]));
            const float v = upright(p, x) + (0.5f * c - 0.25f * (p[x - 2 * s] + p[x + 2 * s]));
            const bool chroma = (x & 1) == column;
            red[x] = chroma ? c - h : 0.0f;
            blue[x] = chroma ? c - v : 0.0f;
        }
    } else if (step == GREEN) {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            // Changes of the differences along each direction, nearer ones more.
            float across = 0.0f, down = 0.0f;
            for (int k = -2; k <= 2; ++k) {
                const float *h = red + x + k * s, *v = blue + x + k;
                const float weight = k == 0 ? 3.0f : 1.0f;
                if (k & 1) {
                    across += size(h[-1] - h[1]);
                    down += size(v[-s] - v[s]);
                } else {
                    across += weight * size(h[0] - h[2]);
                    across += weight * size(h[-2] - h[0]);
                    down += weight * size(v[0] - v[2 * s]);
                    down += weight * size(v[-2 * s] - v[0]);
                }
            }
            const bool flat = down >= across;
            direction[x] = flat ? 1.0f : 0.0f;
            green[x] = p[x] - either(flat, red[x], blue[x]);
        }
    } else if (step == AT_GREEN) {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const float c = p[x];
            const bool chroma = (x & 1) == column;
            const float a = (c + level(p, x)) - level(green, x);
            const float b = (c + upright(p, x)) - upright(green, x);
            own[x] = either(chroma, own[x], a);
            other[x] = either(chroma, other[x], b);
        }
    } else if (step == AT_CHROMA) {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const float c = p[x];
            const bool chroma = (x & 1) == column;
            const float a = (c + level(other, x)) - level(own, x);
            const float b = (c + upright(other, x)) - upright(own, x);
            const float found = either(direction[x] > 0.0f, a, b);
            own[x] = either(chroma, c, own[x]);
            other[x] = either(chroma, found, other[x]);
        }
    } else if (step == REFINE_GREEN || step == REFINE_AT_CHROMA) {
        float* to = step == REFINE_GREEN ? green : other;
        const float *a = step == REFINE_GREEN ? own : other,
                    *b = step == REFINE_GREEN ? green : own;
        const float sign = step == REFINE_GREEN ? -third : third;
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const float here = a[x] - b[x];
            const float h = ((a[x - 1] - b[x - 1]) + here) + (a[x + 1] - b[x + 1]);
            const float v = ((a[x - s] - b[x - s]) + here) + (a[x + s] - b[x + s]);
            const float found = own[x] + sign * either(direction[x] > 0.0f, h, v);
            to[x] = either((x & 1) == column, found, to[x]);
        }
    } else {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const bool chroma = (x & 1) == column;
            const float h = (own[x - 1] - green[x - 1]) + (own[x + 1] - green[x + 1]);
            const float v = (other[x - s] - green[x - s]) + (other[x + s] - green[x + s]);
            const float a = green[x] + 0.5f * h, b = green[x] + 0.5f * v;
            own[x] = either(chroma, own[x], a);
            other[x] = either(chroma, other[x], b);
        }
    }
}
