// The winner among the costs of a pixel: one rule for every device and every way to store costs.
//
// Let c be the smallest cost, at index k; the first of equal costs wins. Let r, the rival, be the
// smallest cost more than one index away. The winner is unique unless r (100 - uniqueness) < 100 c.
// Its confidence is 1 - c / r, limited to [0, 1]: 0 if that is NaN, 1 if c is infinitely low. Let a
// and b be the costs before and after k, minus c. Then the disparity is
//
//     first + k + (a - b) / (2 (a + b))      by a parabola
//     first + k + (a - b) / (2 max(a, b))    by two lines of opposite slope
//
// WIDE holds differences of two costs, and the product of a cost and 100.
// needs WIDE, NO_SUBPIXEL, PARABOLA
struct Winner {
    int place;    // k
    WIDE cost;    // c
    WIDE rival;   // r
    bool alone;   // whether there is no rival
    bool inner;   // whether there are costs before and after
    WIDE before;  // a
    WIDE after;   // b

    static float of_bits(unsigned bits) {
        union {
            unsigned bits;
            float value;
        } number = {bits};
        return number.value;
    }

    float offset(int subpixel) const {
        const float infinity = of_bits(0x7f800000u);
        if (subpixel == NO_SUBPIXEL || !inner) return 0.0f;
        const WIDE greater = before > after ? before : after;
        const float n = before - after, m = subpixel == PARABOLA ? before + after : greater;
        const bool exists = 0.0f < m && m < infinity && -infinity < n && n < infinity;
        return exists ? 0.5f * (n / m) : 0.0f;
    }

    void store(int first, int subpixel, int uniqueness, int* to_index, float* to_disparity,
               float* to_cost, float* to_confidence) const {
        const float least = cost, second = alone ? of_bits(0x7f800000u) : (float)rival;
        // The share of an infinitely good cost has no bound.
        const float share = least > -of_bits(0x7f800000u) ? 1.0f - least / second : 1.0f;
        const float margin = second > least ? share : 0.0f;
        const bool rivalled = !alone && rival * (WIDE)(100 - uniqueness) < cost * (WIDE)100;
        const bool unique = uniqueness == 0 || !rivalled;
        *to_index = unique ? place : -1;
        *to_disparity = unique ? (float)(first + place) + offset(subpixel) : of_bits(0x7fc00000u);
        *to_cost = least;
        *to_confidence = margin > 1.0f ? 1.0f : margin > 0.0f ? margin : 0.0f;
    }
};
