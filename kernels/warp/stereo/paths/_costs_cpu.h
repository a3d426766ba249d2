// The cost of a match: WEIGHT times the Hamming distance of the census, three bytes, plus the
// difference of the grey values, shifted right by SHIFT, but at most LIMIT.
//
// The right image is unfolded: each of its rows becomes LINES lines, one for each byte of the
// census and one for the grey values. They are reversed, so that the partners of a left pixel are
// adjacent.
// needs SPAN, LINES, WEIGHT, SHIFT, LIMIT
struct MatchCost {
    typedef unsigned char bytes __attribute__((vector_size(SPAN), aligned(1)));

    bytes census[3], gray;
    const unsigned char* right;
    int length;

    static MatchCost of_pixel(unsigned long long bits, unsigned char gray,
                              const unsigned char* right, int length) {
        const bytes none = {};
        return {{none + (unsigned char)bits, none + (unsigned char)(bits >> 8),
                 none + (unsigned char)(bits >> 16)},
                none + gray,
                right,
                length};
    }

    // The costs of SPAN disparities, beginning at d.
    bytes at(int d) const {
        const unsigned char* const r = right + d;
        bytes distance = {};
#pragma clang loop unroll(full)
        for (int i = 0; i < 3; ++i)
            distance += __builtin_elementwise_popcount(*(const bytes*)(r + i * length) ^ census[i]);
        const bytes other = *(const bytes*)(r + 3 * length);
        const bytes high = __builtin_elementwise_max(gray, other);
        const bytes apart = (high - __builtin_elementwise_min(gray, other)) >> (unsigned char)SHIFT;
        return distance * (unsigned char)WEIGHT +
               __builtin_elementwise_min(apart, (bytes){} + (unsigned char)LIMIT);
    }
};
