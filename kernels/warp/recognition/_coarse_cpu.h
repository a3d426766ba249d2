// needs LARGEST
// A patch by the means of 2 x 2 pixels. With a = up(m) + r, where up() repeats a mean four times,
// and S the sums of r over 2 x 2 pixels, which are small, because means are rounded,
//     a b = 4 m m' + m S' + S m' + S S' / 4 + h h' + v v' + d d'
// where h, v and d are the differences down, along and across within 2 x 2 pixels. By Cauchy and
// Schwarz, that is at most
//     4 m m' + (|m| + |S| / 4) |S'| + |S| |m'| + |h| |h'| + |v| |v'| + |d| |d'|
struct Coarse {
    int size;           // number of means, with zeros behind them: a multiple of 4
    int length, error;  // |m| and |S|, rounded up
    int rest[3];        // |h|, |v| and |d|, rounded up
    signed char mean[LARGEST / 4];

    static int root(int square) { return (int)__builtin_ceil(__builtin_sqrt((double)square)); }

    void see(const signed char* patch, int bytes) {
        const int side = (int)__builtin_sqrt((double)bytes);
        const int half = side / 2, count = half * half;
        short down[LARGEST], less[LARGEST], four[LARGEST];
        const int last = bytes - side - 1;
        for (int k = 0; k <= last; ++k) {
            down[k] = patch[k] + patch[k + side];
            less[k] = patch[k] - patch[k + side];
        }
        for (int k = 0; k < last; ++k) four[k] = down[k] + down[k + 1];
        size = (count + 3) / 4 * 4;
        for (int k = count; k < size; ++k) mean[k] = 0;
        int all = 0, seen = 0, squares = 0, errors = 0, k = 0, rests[3] = {0, 0, 0};
        for (int i = 0; i < bytes; ++i) all += patch[i] * patch[i];
        for (int y = 0; y < half; ++y)
            for (int x = 0; x < half; ++x, ++k) {
                const int at = 2 * y * side + 2 * x;
                const int sum = four[at], m = (sum + 2) >> 2, e = sum - 4 * m;
                const int h = less[at] + less[at + 1], v = down[at] - down[at + 1];
                const int d = less[at] - less[at + 1];
                mean[k] = m;
                squares += m * m, errors += e * e, seen += sum * sum;
                rests[0] += h * h, rests[1] += v * v, rests[2] += d * d;
            }
        // Pixels that are in no 2 x 2 pixels count with the first.
        const int behind = all - (seen + rests[0] + rests[1] + rests[2]) / 4;
        length = root(squares), error = root(errors);
        for (int i = 0; i < 3; ++i) rest[i] = root((rests[i] + 3) / 4 + (i ? 0 : behind));
    }
};
