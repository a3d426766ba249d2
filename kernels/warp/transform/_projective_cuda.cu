// needs CHANNELS, PLACE_BITS, START, START_HIGH, COLUMNS, ROWS, WARPS
// Bytes of an image seen through a homography, linearly: `inverse` takes (x, y, 1) of the result to
// the image; _bytes.py has the equation. The lanes of a warp take neighbouring pixels of a row, and
// each lane COLUMNS pixels of ROWS rows. Returns, as bits, the pixels that it leaves to others: those
// beyond the pixels of the image, unless all there is `outside`.
int warp_part(int item, wp::array_t<wp::uint8> src, wp::array_t<double> inverse, int constant,
              int outside, wp::array_t<wp::uint8> dst) {
    enum { C = CHANNELS, LANES = 32, WIDE = LANES * COLUMNS, REST = 32 - PLACE_BITS };
    typedef unsigned int word;
    struct Reading {
        // 1 / w to the nearest, as the compiler divides normal numbers, but without a branch.
        static double reciprocal(double w) {
            double guess;
            asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(guess) : "d"(w));
            double r = __hiloint2double(__double2hiint(guess), __double2hiint(w) + 0x300402);
            double e = fma(-w, r, 1.0);
            e = fma(e, e, e);
            r = fma(r, e, r);
            e = fma(-w, r, 1.0);
            return fma(r, e, r);
        }

        // From the bytes of two pixels of each of two rows, four of each channel.
        static void gather(const word (&top)[2], const word (&low)[2], word (&four)[C]) {
            if (C == 1) {
                four[0] = __byte_perm(top[0], low[0], 0x5410);
            } else if (C == 3) {
                const word west = __byte_perm(top[0], low[0], 0x6521);
                const word east = __byte_perm(top[1], low[1], 0x5410);
                four[0] = __byte_perm(top[0], low[0], 0x7430);
                four[1 % C] = __byte_perm(west, east, 0x6240);
                four[2 % C] = __byte_perm(west, east, 0x7351);
            } else {
#pragma unroll
                for (int half = 0; half < 2; ++half) {
                    const word pick = half ? 0x7362 : 0x5140;
                    const word above = __byte_perm(top[0], top[1], pick);
                    const word below = __byte_perm(low[0], low[1], pick);
                    four[2 * half % C] = __byte_perm(above, below, 0x5410);
                    four[(2 * half + 1) % C] = __byte_perm(above, below, 0x7632);
                }
            }
        }

        // Four pixels of all channels, weighed, from two words or three of each row.
        static word mix(const word (&words)[2][3], word upper, word lower, word x, word y) {
            word rows[2][2], four[C], sum[C];
#pragma unroll
            for (int n = 0; n < 2; ++n) {
                const word shift = 8 * (n ? lower : upper);  // five bits of it count
                rows[n][0] = __funnelshift_r(words[n][0], words[n][1], shift);
                if (C > 1) rows[n][1] = __funnelshift_r(words[n][1], words[n][2], shift);
            }
            gather(rows[0], rows[1], four);
            const word a = x >> REST, b = y >> REST;
            const word both = __umulhi(a << REST, b), low = b - both;
            const word east = a - both, none = (1u << PLACE_BITS) - a - low;
            // The upper 16 bits and the lower 8 of each weight.
            const word top_weights = __byte_perm(none, east, 0x6521);
            const word low_weights = __byte_perm(low, both, 0x6521);
            const word fine = __byte_perm(__byte_perm(none, east, 0x0040),
                                          __byte_perm(low, both, 0x0040), 0x5410);
#pragma unroll
            for (int c = 0; c < C; ++c) {
                const word half = 1u << (PLACE_BITS - 9);
                const word coarse =
                    __dp2a_hi(low_weights, four[c], __dp2a_lo(top_weights, four[c], half));
                sum[c] = 512 * coarse + 2 * __dp4a(fine, four[c], 0u);
            }
            return bytes(sum);
        }

        // The highest bytes of the sums of all channels.
        static word bytes(const word (&sum)[C]) {
            if (C == 1) return sum[0] >> 24;
            const word two = __byte_perm(sum[0], sum[1 % C], 0x0073);
            if (C == 3) return __byte_perm(two, sum[2 % C], 0x4710);
            return __byte_perm(two, __byte_perm(sum[2 % C], sum[3 % C], 0x0073), 0x5410);
        }

        // Put the bytes of a lane, and of the lanes behind it, into its word of the result.
        static word join(word own, int phase) {
            if (C == 4) return own;
            const word next = __shfl_down_sync(~0u, own, 1);
            if (C == 3)
                return __byte_perm(own, next, phase == 0 ? 0x4210 : phase == 1 ? 0x5421 : 0x6542);
            const word two = __byte_perm(own, next, 0x0040);
            return __byte_perm(two, __shfl_down_sync(~0u, two, 2), 0x5410);
        }
    };
    const double* const m = inverse.data;
    const int planes = dst.shape[0], tall = dst.shape[1], wide = dst.shape[2];
    const int height = src.shape[1], width = src.shape[2], pitch = width * C;
    const int lane = item % LANES, warp = item / LANES, across = (wide + WIDE - 1) / WIDE;
    const int block = warp / WARPS, start = block % across * WIDE, column = start + lane;
    const int begin = (block / across * WARPS + warp % WARPS) * ROWS;
    const int end = begin + ROWS < tall ? begin + ROWS : tall;
    const word last_x = width - 1, last_y = height - 1;
    // The word that a lane writes: of four bytes of the pixels of four lanes, or its own.
    const int phase = lane % 4,
              offset = C == 4 ? 4 * lane : lane / 4 * 4 * C + (C == 3 ? 4 * phase : 0);
    const bool writes = C == 4 || phase < C;
    double x_of_column[COLUMNS], y_of_column[COLUMNS], w_of_column[COLUMNS];
#pragma unroll
    for (int k = 0; k < COLUMNS; ++k) {
        const double u = min(column + LANES * k, wide - 1);
        x_of_column[k] = m[0] * u, y_of_column[k] = m[3] * u, w_of_column[k] = m[6] * u;
    }
    // The words of x and y: pixel and fraction.
    struct Place {
        word x, y, right, down;
    };
    const auto find = [&](int k, double x_of_row, double y_of_row, double w_of_row) {
        const double r = Reading::reciprocal(w_of_column[k] + w_of_row);
        const double x = (x_of_column[k] + x_of_row) * r + START;
        const double y = (y_of_column[k] + y_of_row) * r + START;
        return Place{(word)__double2hiint(x), (word)__double2hiint(y), (word)__double2loint(x),
                     (word)__double2loint(y)};
    };
    // A homography takes a rectangle whose corners have one sign of w to the quadrangle of their
    // images. If these are inside, so are all pixels, and no word that they need is beyond. If they
    // are beyond one side, all pixels are `outside`.
    bool inner, away;
    {
        const double u = lane & 1 ? min(start + WIDE, wide) - 1 : start;
        const double v = lane & 2 ? end - 1 : begin;
        const double w = m[6] * u + (m[7] * v + m[8]), r = 1.0 / w;
        const double x = (m[0] * u + (m[1] * v + m[2])) * r;
        const double y = (m[3] * u + (m[4] * v + m[5])) * r;
        // Where sums cancel, rounding may be more than the margin, 1/1024 of a pixel.
        const double most = 16777216.0 * fabs(w);
        const bool safe = fabs(m[0]) * u + (fabs(m[1]) * v + fabs(m[2])) < most &&
                          fabs(m[3]) * u + (fabs(m[4]) * v + fabs(m[5])) < most &&
                          fabs(m[6]) * u + (fabs(m[7]) * v + fabs(m[8])) < 0.00390625 * most;
        const double margin = 0.0009765625, right = last_x, bottom = last_y;
        const auto all = [](bool corner) { return __all_sync(~0u, corner); };
        const bool even = all(safe) && (all(w > 0.0) || all(w < 0.0)) && begin < end &&
                          (size_t)dst.data % 4 == 0 && (C == 4 || wide % 4 == 0);
        inner =
            even && (size_t)src.data % 4 == 0 && pitch % 4 == 0 &&
            all(x >= margin && x <= right - margin && y >= margin && y <= bottom - 1.0 - margin);
        away = even && constant &&
               (all(x <= -margin) || all(x >= right + margin) || all(y <= -margin) ||
                all(y >= bottom + margin));
    }
    if (inner) {
        // Words wrap around, so the upper halves of START are taken off at once.
        const word origin = 0u - (word)START_HIGH * ((word)pitch + C);
        for (int p = 0; p < planes; ++p) {
            const char* const plane = (const char*)src.data + (size_t)p * height * pitch;
            wp::uint8* to = dst.data + (((size_t)p * tall + begin) * wide + start) * C + offset;
#pragma unroll 1
            for (int row = begin; row < end; ++row, to += (size_t)wide * C) {
                const double v = row;
                const double x_of_row = m[1] * v + m[2], y_of_row = m[4] * v + m[5];
                const double w_of_row = m[7] * v + m[8];
                word at[COLUMNS], right[COLUMNS], down[COLUMNS], words[COLUMNS][2][3];
#pragma unroll
                for (int k = 0; k < COLUMNS; ++k) {
                    const Place place = find(k, x_of_row, y_of_row, w_of_row);
                    right[k] = place.right, down[k] = place.down;
                    at[k] = place.y * pitch + (place.x * C + origin);
                    const char* q = plane + (at[k] & ~3u);
#pragma unroll
                    for (int n = 0; n < 2; ++n, q += pitch)
#pragma unroll
                        for (int part = 0; part < (C == 1 ? 2 : C == 4 ? 2 : 3); ++part)
                            words[k][n][part] = __ldg((const word*)q + part);
                }
#pragma unroll
                for (int k = 0; k < COLUMNS; ++k) {
                    if (C == 4) words[k][0][2] = words[k][1][2] = 0;
                    const word made = Reading::mix(words[k], at[k], at[k], right[k], down[k]);
                    const word joined = Reading::join(made, phase);
                    if (writes && column + LANES * k < wide) *(word*)(to + LANES * k * C) = joined;
                }
            }
        }
        return 0;
    }
    if (away) {
        for (int p = 0; p < planes; ++p)
            for (int row = begin; row < end; ++row) {
                wp::uint8* const to = dst.data + (((size_t)p * tall + row) * wide + start) * C;
                const word joined = Reading::join(outside, phase);
#pragma unroll
                for (int k = 0; k < COLUMNS; ++k)
                    if (writes && column + LANES * k < wide)
                        *(word*)(to + offset + LANES * k * C) = joined;
            }
        return 0;
    }
    int left = 0;
#pragma unroll 1
    for (int row = begin; row < end; ++row) {
        const double v = row;
        const double x_of_row = m[1] * v + m[2], y_of_row = m[4] * v + m[5];
        const double w_of_row = m[7] * v + m[8];
        word at[COLUMNS], right[COLUMNS], down[COLUMNS], below[COLUMNS];
        bool good[COLUMNS];
#pragma unroll
        for (int k = 0; k < COLUMNS; ++k) {
            const Place place = find(k, x_of_row, y_of_row, w_of_row);
            const word j = place.x - START_HIGH, i = place.y - START_HIGH;
            right[k] = place.right, down[k] = place.down;
            good[k] = (j < last_x || (j == last_x && right[k] >> REST == 0)) &&
                      (i < last_y || (i == last_y && down[k] >> REST == 0));
            at[k] = good[k] ? i * pitch + j * C : 0;
            below[k] = good[k] && i < last_y ? pitch : 0;
            if (!good[k] && !constant && column + LANES * k < wide)
                left |= 1 << ((row - begin) * COLUMNS + k);
        }
        for (int p = 0; p < planes; ++p) {
            const wp::uint8* const plane = src.data + (size_t)p * height * pitch;
            const word shifted = (size_t)plane & 3;
            const word* const from = (const word*)(plane - shifted);
            // Words beyond those of the plane are not read; their bytes have no weight.
            const word last = (shifted + (word)height * pitch - 1) >> 2;
            wp::uint8* const to = dst.data + (((size_t)p * tall + row) * wide + start) * C;
            const bool whole = ((size_t)to & 3) == 0 && (C == 4 || wide % 4 == 0);
            word words[COLUMNS][2][3];
#pragma unroll
            for (int k = 0; k < COLUMNS; ++k)
#pragma unroll
                for (int n = 0; n < 2; ++n) {
                    const word place = (at[k] + shifted + n * below[k]) >> 2;
#pragma unroll
                    for (int part = 0; part < (C == 1 ? 2 : 3); ++part)
                        words[k][n][part] = __ldg(from + min(place + part, last));
                }
#pragma unroll
            for (int k = 0; k < COLUMNS; ++k) {
                const word first = at[k] + shifted;
                const word mixed =
                    Reading::mix(words[k], first, first + below[k], right[k], down[k]);
                const word made = good[k] ? mixed : outside;
                const word joined = Reading::join(made, phase);
                if (column + LANES * k >= wide) continue;
                if (whole) {
                    if (writes) *(word*)(to + offset + LANES * k * C) = joined;
                } else {
#pragma unroll
                    for (int c = 0; c < C; ++c)
                        to[(lane + LANES * k) * C + c] = (wp::uint8)(made >> 8 * c);
                }
            }
        }
    }
    __syncwarp();  // others write single bytes after these words
    return left;
}
