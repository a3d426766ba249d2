// Sums of matching costs over windows, LANES disparities in a vector, row by row of the image.
//
// COST is one of SAD, SSD, BIRCHFIELD_TOMASI, CENSUS and ZNCC (sums of products). PIXEL is the type
// of a value, SUM the type of a sum. ELEMENT is the type of an image element: PIXEL, or a word of 8
// octets, where each of the first `octets` is a separate channel.
// needs COST, SAD, SSD, BIRCHFIELD_TOMASI, CENSUS, ZNCC, PIXEL, ELEMENT, SUM, LANES, FLOATS
#if COST == BIRCHFIELD_TOMASI
#define PLANES 3  // lines of values, and of the smallest and largest value near each
#else
#define PLANES 1
#endif
struct WindowRow {
    typedef PIXEL pixels
        __attribute__((vector_size(LANES * sizeof(PIXEL)), aligned(sizeof(PIXEL)), may_alias));
    typedef SUM sums
        __attribute__((vector_size(LANES * sizeof(SUM)), aligned(sizeof(SUM)), may_alias));

    const ELEMENT *left, *right;
    int height, width, stride, octets, start, count, radius_y, radius_x;
    PIXEL* lines;  // this thread's lines of two rows
    SUM* columns;  // this thread's sums down the columns

    int channels() const { return stride * octets; }
    int range() const { return (count + LANES - 1) / LANES * LANES; }
    int wide() const { return width + 2 * radius_x; }
    // One more place on each side, for the neighbours of the outermost pixels.
    int left_pitch() const { return wide() + 2; }
    int right_pitch() const { return wide() + range() + 2; }
    size_t right_lines() const { return (size_t)PLANES * channels() * left_pitch(); }
    size_t row_lines() const { return right_lines() + (size_t)PLANES * channels() * right_pitch(); }

    static PIXEL value(ELEMENT element, int octet) {
#if COST == CENSUS
        return element >> 8 * octet;
#else
        return element;
#endif
    }

    // Fill a line with one row, extended on both sides by its outermost pixels: place i has column
    // x + step i.
    void put(PIXEL* to, int length, const ELEMENT* from, int octet, int x, int step) const {
        // Places `first` to `last` are in the image.
        int first = step > 0 ? -x : x - width + 1, last = step > 0 ? width - x : x + 1;
        first = first < 0 ? 0 : first < length ? first : length;
        last = last < first ? first : last < length ? last : length;
        const PIXEL least = value(from[0], octet);
        const PIXEL most = value(from[(size_t)(width - 1) * stride], octet);
        for (int i = 0; i < first; ++i) to[i] = step > 0 ? least : most;
        for (int i = last; i < length; ++i) to[i] = step > 0 ? most : least;
        if (stride > 1) {
            for (int i = first; i < last; ++i)
                to[i] = value(from[(size_t)(x + step * i) * stride], octet);
        } else if (step > 0) {
#pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = value(from[x + i], octet);
        } else {
#pragma clang loop vectorize(assume_safety)
            for (int i = first; i < last; ++i) to[i] = value(from[x - i], octet);
        }
        if (PLANES == 1) return;
        // The smallest and the largest value within half a pixel of a pixel.
        PIXEL* const low = to + (size_t)channels() * length;
        PIXEL* const high = low + (size_t)channels() * length;
        low[0] = low[length - 1] = high[0] = high[length - 1] = 0;
#pragma clang loop vectorize(assume_safety)
        for (int i = 1; i < length - 1; ++i) {
            const PIXEL here = to[i], one = (to[i - 1] + here) / 2, two = (here + to[i + 1]) / 2;
            const PIXEL least = one < two ? one : two, most = one < two ? two : one;
            low[i] = here < least ? here : least;
            high[i] = here < most ? most : here;
        }
    }

    // Fill the lines of a row of both images: for each channel the values, then, if the cost needs
    // them, the smallest and largest ones. Lines of the right image are reversed, so that the
    // partners of a pixel are in the order of their disparities.
    void put_row(int row, int place) const {
        row = row < 0 ? 0 : row < height ? row : height - 1;
        PIXEL* const to = lines + place * row_lines();
        for (int c = 0; c < channels(); ++c) {
            const size_t from = (size_t)row * width * stride + c / octets;
            put(to + (size_t)c * left_pitch(), left_pitch(), left + from, c % octets, -radius_x - 1,
                1);
            put(to + right_lines() + (size_t)c * right_pitch(), right_pitch(), right + from,
                c % octets, width + radius_x - start, -1);
        }
    }

    // Return the costs of LANES disparities. `l` is a value of the left image, `r` its first
    // partner; the lines of the next channels are `left_step` and `right_step` away.
    __attribute__((always_inline)) static sums costs(const PIXEL* l, const PIXEL* r, int count_of,
                                                     size_t left_step, size_t right_step) {
        sums total = {};
        pixels bytes = {};
        for (int c = 0; c < count_of; ++c, l += left_step, r += right_step) {
            const pixels a = l[0] - (pixels){};
            const pixels b = *(const pixels*)r;
#if COST == SAD
            total += __builtin_convertvector(a < b ? b - a : a - b, sums);
#elif COST == SSD
            const sums d = __builtin_convertvector(a < b ? b - a : a - b, sums);
            total += d * d;
#elif COST == ZNCC
            total += __builtin_convertvector(a, sums) * __builtin_convertvector(b, sums);
#elif COST == CENSUS
            bytes += __builtin_elementwise_popcount(a ^ b);
            if (c % 16 < 15 && c < count_of - 1) continue;  // bytes hold 16 sums of 8 bits
            total += __builtin_convertvector(bytes, sums);
            bytes = (pixels){};
#else
            const size_t left_plane = count_of * left_step, right_plane = count_of * right_step;
            const pixels a_low = l[left_plane] - (pixels){};
            const pixels a_high = l[2 * left_plane] - (pixels){};
            const pixels b_low = *(const pixels*)(r + right_plane);
            const pixels b_high = *(const pixels*)(r + 2 * right_plane);
            const pixels over = __builtin_elementwise_max(a, b_high) - b_high;
            const pixels under = __builtin_elementwise_max(a, b_low) - a;
            const pixels back = __builtin_elementwise_max(b, a_high) - a_high;
            const pixels down = __builtin_elementwise_max(b, a_low) - b;
            const pixels d = __builtin_elementwise_min(__builtin_elementwise_max(over, under),
                                                       __builtin_elementwise_max(back, down));
            total += __builtin_convertvector(d, sums);
#endif
        }
        return total;
    }

#if COST == CENSUS
    // The same for fewer than 32 octets, as bytes.
    __attribute__((always_inline)) static pixels distances(const PIXEL* l, const PIXEL* r,
                                                           int count_of, size_t left_step,
                                                           size_t right_step) {
        pixels bytes = {};
        for (int c = 0; c < count_of; ++c, l += left_step, r += right_step)
            bytes += __builtin_elementwise_popcount((l[0] - (pixels){}) ^ *(const pixels*)r);
        return bytes;
    }
#endif
};
#undef PLANES

// Call ``emit(total, x, chunk)`` with each sum of row y. x is the last column of its window,
// counted from the begin of the lines; its disparities begin at `chunk`. Integers have running
// sums: from one row to the next, one row of costs is added and one subtracted, and likewise along
// the row. Floats are summed again: each column from top to bottom, then the columns from left to
// right.
const auto sum_windows = [](const WindowRow& row, int y, bool restart,
                            const auto& emit) __attribute__((always_inline)) {
    typedef WindowRow::sums sums;
    const int range = row.range(), wide = row.wide(), radius_x = row.radius_x;
    const int channels = row.channels();
    const size_t left_step = row.left_pitch(), right_step = row.right_pitch();
    SUM* const columns = row.columns;
    // The begin of the lines of the row that is added, and of the row that is subtracted.
    const PIXEL* const left_new = row.lines + 1;
    const PIXEL* const right_new = row.lines + row.right_lines() + wide;
    const PIXEL* const left_old = left_new + row.row_lines();
    const PIXEL* const right_old = right_new + row.row_lines();
    const bool anew = FLOATS || restart;
    if (anew) {
        for (size_t i = 0; i < (size_t)wide * range; ++i) columns[i] = 0;
        for (int v = y - row.radius_y; v < y + row.radius_y; ++v) {
            row.put_row(v, 0);
            for (int chunk = 0; chunk < range; chunk += LANES)
                for (int x = 0; x < wide; ++x)
                    *(sums*)(columns + (size_t)wide * chunk + x * LANES) += WindowRow::costs(
                        left_new + x, right_new - x + chunk, channels, left_step, right_step);
        }
    } else {
        row.put_row(y - row.radius_y - 1, 1);
    }
    row.put_row(y + row.radius_y, 0);
    const auto run = [&](auto fixed) __attribute__((always_inline)) {
        const int number = decltype(fixed)::VALUE ? decltype(fixed)::VALUE : channels;
        for (int chunk = 0; chunk < range; chunk += LANES) {
            SUM* const column = columns + (size_t)wide * chunk;
            sums total = {};
            for (int x = 0; x < wide; ++x) {
                sums* const here = (sums*)(column + x * LANES);
                const PIXEL *const one = left_new + x, *const other = right_new - x + chunk;
                const PIXEL *const past = left_old + x, *const gone = right_old - x + chunk;
                sums sum = *here;
#if COST == CENSUS
                if (decltype(fixed)::VALUE && !anew) {  // changes of fewer than 16 octets fit bytes
                    typedef signed char changes __attribute__((vector_size(LANES)));
                    const auto change =
                        WindowRow::distances(one, other, number, left_step, right_step) -
                        WindowRow::distances(past, gone, number, left_step, right_step);
                    sum += __builtin_convertvector((changes)change, sums);
                } else
#endif
                {
                    sum += WindowRow::costs(one, other, number, left_step, right_step);
                    if (!anew) sum -= WindowRow::costs(past, gone, number, left_step, right_step);
                }
                *here = sum;
                total += sum;
                if (x < 2 * radius_x) continue;
                const SUM* const oldest = column + (x - 2 * radius_x) * LANES;
                if (FLOATS) {
                    total = *(const sums*)oldest;
                    for (int i = 1; i <= 2 * radius_x; ++i)
                        total += *(const sums*)(oldest + i * LANES);
                }
                emit(total, x, chunk);
                total -= *(const sums*)oldest;
            }
        }
    };
    struct Any {
        enum { VALUE = 0 };
    };
    struct Three {
        enum { VALUE = 3 };
    };
    if (COST == CENSUS && channels == Three::VALUE)  // a census of 5 x 5
        run(Three());
    else
        run(Any());
};
