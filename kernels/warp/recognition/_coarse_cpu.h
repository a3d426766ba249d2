// needs LARGEST
// A patch by the means of 2 x 2 pixels. With a = up(m) + r, where up() repeats a mean four times,
// a product of two patches is, by Cauchy and Schwarz,
//     a b = 4 m m' + m S' + S m' + r r'  <=  4 m m' + |m| |S'| + |S| |m'| + |r| |r'|
// where S are the sums of r over 2 x 2 pixels, which are small, because means are rounded.
struct Coarse {
    int size;           // number of means, with zeros behind them: a multiple of 4
    int length, error;  // |m| and |S|, rounded up
    int rest;           // |r|, rounded up
    signed char mean[LARGEST / 4];

    static int root(int square) { return (int)__builtin_ceil(__builtin_sqrt((double)square)); }

    void see(const signed char* patch, int bytes) {
        const int side = (int)__builtin_sqrt((double)bytes);
        const int half = side / 2, count = half * half;
        short down[LARGEST], four[LARGEST];
        const int last = bytes - side - 1;
        for (int k = 0; k <= last; ++k) down[k] = patch[k] + patch[k + side];
        for (int k = 0; k < last; ++k) four[k] = down[k] + down[k + 1];
        size = (count + 3) / 4 * 4;
        for (int k = count; k < size; ++k) mean[k] = 0;
        int all = 0, squares = 0, with = 0, errors = 0, k = 0;
        for (int i = 0; i < bytes; ++i) all += patch[i] * patch[i];
        for (int y = 0; y < half; ++y)
            for (int x = 0; x < half; ++x, ++k) {
                const int sum = four[2 * y * side + 2 * x], m = (sum + 2) >> 2, e = sum - 4 * m;
                mean[k] = m;
                squares += m * m, with += m * sum, errors += e * e;
            }
        length = root(squares), error = root(errors);
        rest = root(all - 2 * with + 4 * squares);
    }
};
