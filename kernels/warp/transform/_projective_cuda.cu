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
        const double u = column + LANES * k;
        x_of_column[k] = m[0] * u, y_of_column[k] = m[3] * u, w_of_column[k] = m[6] * u;
    }
    int left = 0;
#pragma unroll 1
    for (int row = begin; row < end; ++row) {
        const double v = row;
        const double x_of_row = m[1] * v + m[2], y_of_row = m[4] * v + m[5];
        const double w_of_row = m[7] * v + m[8];
        word at[COLUMNS], fraction_x[COLUMNS], fraction_y[COLUMNS];
        word pixel_x[COLUMNS], pixel_y[COLUMNS];
        bool good[COLUMNS], all = true;
#pragma unroll
        for (int k = 0; k < COLUMNS; ++k) {
            const double r = Reading::reciprocal(w_of_column[k] + w_of_row);
            const double x = (x_of_column[k] + x_of_row) * r + START;
            const double y = (y_of_column[k] + y_of_row) * r + START;
            const word j = __double2hiint(x) - START_HIGH, i = __double2hiint(y) - START_HIGH;
            fraction_x[k] = __double2loint(x), fraction_y[k] = __double2loint(y);
            good[k] = j < last_x && i < last_y - 1;
            all = all && good[k];
            at[k] = good[k] ? i * pitch + j * C : 0;
            pixel_x[k] = j, pixel_y[k] = i;
        }
        if (!all)
            for (int k = 0; k < COLUMNS; ++k) {
                const word j = pixel_x[k], i = pixel_y[k];
                const bool beyond = j > last_x || (j == last_x && fraction_x[k] >> REST) ||
                                    i > last_y || (i == last_y && fraction_y[k] >> REST);
                if (!good[k] && !(constant && beyond) && column + LANES * k < wide)
                    left |= 1 << ((row - begin) * COLUMNS + k);
            }
        for (int p = 0; p < planes; ++p) {
            const wp::uint8* const plane = src.data + (size_t)p * height * pitch;
            const word shifted = (size_t)plane & 3;
            const wp::uint8* const from = plane - shifted;
            wp::uint8* const to = dst.data + (((size_t)p * tall + row) * wide + start) * C;
            const bool whole = ((size_t)to & 3) == 0 && (C == 4 || wide % 4 == 0);
            word words[COLUMNS][2][3];
#pragma unroll
            for (int k = 0; k < COLUMNS; ++k)
#pragma unroll
                for (int n = 0; n < 2; ++n) {
                    const word place = at[k] + shifted + n * pitch;
                    const word* const q = (const word*)(from + (place & ~3u));
#pragma unroll
                    for (int part = 0; part < (C == 1 ? 2 : 3); ++part)
                        words[k][n][part] = __ldg(q + part);
                }
#pragma unroll
            for (int k = 0; k < COLUMNS; ++k) {
                word rows[2][2], four[C];
#pragma unroll
                for (int n = 0; n < 2; ++n) {
                    const word shift = 8 * (at[k] + shifted + n * pitch);  // five bits of it count
                    rows[n][0] = __funnelshift_r(words[k][n][0], words[k][n][1], shift);
                    if (C > 1) rows[n][1] = __funnelshift_r(words[k][n][1], words[k][n][2], shift);
                }
                Reading::gather(rows[0], rows[1], four);
                const word a = fraction_x[k] >> REST;
                const word b = fraction_y[k] >> REST;
                const word both = __umulhi(a << REST, b), low = b - both;
                const word east = a - both, none = (1u << PLACE_BITS) - a - low;
                // The upper 16 bits and the lower 8 of each weight.
                const word top_weights = __byte_perm(none, east, 0x6521);
                const word low_weights = __byte_perm(low, both, 0x6521);
                const word fine = __byte_perm(__byte_perm(none, east, 0x0040),
                                              __byte_perm(low, both, 0x0040), 0x5410);
                word sum[C];
#pragma unroll
                for (int c = 0; c < C; ++c) {
                    const word half = 1u << (PLACE_BITS - 9);
                    const word coarse =
                        __dp2a_hi(low_weights, four[c], __dp2a_lo(top_weights, four[c], half));
                    sum[c] = 512 * coarse + 2 * __dp4a(fine, four[c], 0u);
                }
                const word made = good[k] ? Reading::bytes(sum) : outside;
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
