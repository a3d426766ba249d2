// needs CHANNELS
// Four neighbouring bytes of a row of an image seen through a homography, linearly: `inverse` takes
// (x, y, 1) of the result to the image. Returns, as bits, the pixels that it leaves to others: those
// on the last rows or the last column, and, unless all beyond the image is `cval`, those beyond. So
// nothing is read behind the image, though whole words are read.
int warp_four(int row, int column, wp::array_t<wp::uint8> src, wp::array_t<double> inverse,
              int constant, int outside, wp::array_t<wp::uint8> dst) {
    enum { C = CHANNELS, SIZE = 4 * C };
    const double* const m = inverse.data;
    const int planes = dst.shape[0], tall = dst.shape[1], wide = dst.shape[2];
    const int height = src.shape[1], width = src.shape[2], pitch = width * C;
    const double last_x = width - 1, last_y = height - 1, v = row;
    const bool affine = m[6] == 0.0 && m[7] == 0.0 && m[8] == 1.0;
    const double x_of_row = m[1] * v, y_of_row = m[4] * v, w_of_row = m[7] * v;
    int at[4], left = 0;
    float fx[4], fy[4];
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        const double u = column + k;
        double x = m[0] * u + x_of_row + m[2], y = m[3] * u + y_of_row + m[5];
        if (!affine) {  // to divide by 1 changes nothing
            const double w = m[6] * u + w_of_row + m[8];
            x /= w;
            y /= w;
        }
        const bool good = x >= 0.0 && x < last_x && y >= 0.0 && y < last_y - 1.0;
        const bool within = x >= 0.0 && x <= last_x && y >= 0.0 && y <= last_y;
        const int i = good ? (int)y : 0, j = good ? (int)x : 0;
        fx[k] = (float)(x - (double)j);
        fy[k] = (float)(y - (double)i);
        at[k] = good ? i * pitch + j * C : -1;
        if (!good && !(constant && !within) && column + k < wide) left |= 1 << k;
    }
    for (int p = 0; p < planes; ++p) {
        const wp::uint8* const from = src.data + (size_t)p * height * pitch;
        unsigned words[C];
#pragma unroll
        for (int n = 0; n < C; ++n) words[n] = 0;
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            // The 2 C bytes of both pixels of a row, from whole words.
            unsigned corners[2][2];
            if (at[k] >= 0) {
#pragma unroll
                for (int i = 0; i < 2; ++i) {
                    const size_t place = (size_t)(from + at[k] + i * pitch);
                    const unsigned* const word = (const unsigned*)(place & ~(size_t)3);
                    const unsigned byte = place & 3;
                    const unsigned first = __ldg(word);
                    const unsigned next = byte + 2 * C > 4 ? __ldg(word + 1) : 0;
                    const unsigned last = byte + 2 * C > 8 ? __ldg(word + 2) : 0;
                    corners[i][0] = __funnelshift_r(first, next, 8 * byte);
                    corners[i][1] = __funnelshift_r(next, last, 8 * byte);
                }
            }
            const float x = fx[k], y = fy[k];
#pragma unroll
            for (int c = 0; c < C; ++c) {
                unsigned made = outside;
                if (at[k] >= 0) {
                    const auto value = [&](int i, int n) {
                        return (float)(corners[i][n / 4] >> 8 * (n % 4) & 255);
                    };
                    const float top = (1.0f - x) * value(0, c) + x * value(0, c + C);
                    const float low = (1.0f - x) * value(1, c) + x * value(1, c + C);
                    const float sum = (1.0f - y) * top + y * low;
                    made = (unsigned)(int)((sum < 255.0f ? sum : 255.0f) + 0.5f);
                }
                const int n = k * C + c;
                words[n / 4] |= made << 8 * (n % 4);
            }
        }
        wp::uint8* const to = dst.data + (((size_t)p * tall + row) * wide + column) * C;
        if (column + 4 <= wide && ((size_t)to & 3) == 0) {
#pragma unroll
            for (int n = 0; n < C; ++n) ((unsigned*)to)[n] = words[n];
        } else {
#pragma unroll
            for (int n = 0; n < SIZE; ++n)
                if (column + n / C < wide) to[n] = (wp::uint8)(words[n / 4] >> 8 * (n % 4));
        }
    }
    return left;
}
