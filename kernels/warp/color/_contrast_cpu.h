// Histograms and tone curves on the CPU; the Taichi set has the rules. A slab is a run of pixels, of
// tiles, or of rows of the image, as each function says.

// needs TYPE, LEVEL, REAL, MOST
// The largest channel of the pixels of a slab; floats are scaled and rounded.
void find_levels(int slab, int first, int last, wp::array_t<TYPE> image, float scale,
                 wp::array_t<LEVEL> found) {
#pragma clang fp contract(off)
    const size_t channels = image.shape[1];
    const TYPE* __restrict__ from = image.data;
    LEVEL* __restrict__ to = found.data;
    const auto level = [=](TYPE v) {
        if (!REAL) return (LEVEL)v;
        float value = (float)v * scale;
        value = value > 0.0f ? value : 0.0f;
        value = value < MOST ? value : MOST;
        // Below 2^23 the sum drops the fraction: the nearest integer, and of two the even one.
        return (LEVEL)(int)((value + 8388608.0f) - 8388608.0f);
    };
    if (channels == 1) {
        for (size_t i = first; i < last; ++i) to[i] = level(from[i]);
        return;
    }
    for (size_t i = first; i < last; ++i) {
        TYPE most = from[3 * i];
        most = most > from[3 * i + 1] ? most : from[3 * i + 1];
        most = most > from[3 * i + 2] ? most : from[3 * i + 2];
        to[i] = level(most);
    }
}

// needs LEVEL
// Count the pixels of a slab. Short histograms are eight, or equal neighbours wait for each other.
void count_levels(int slab, int first, int last, wp::array_t<LEVEL> found, wp::array_t<int> parts) {
    const size_t size = (size_t)parts.shape[1] * parts.shape[2];
    const size_t step = parts.shape[1] > 1 ? parts.shape[2] : 0;
    int* __restrict__ counts = parts.data + slab * size;
    const LEVEL* __restrict__ from = found.data;
    for (size_t i = 0; i < size; ++i) counts[i] = 0;
    size_t i = first;
    for (; i + 8 <= last; i += 8)
#pragma clang loop unroll(full)
        for (int k = 0; k < 8; ++k) ++counts[k * step + from[i + k]];
    for (; i < last; ++i) ++counts[from[i]];
}

// needs LEVEL
// The smallest and the largest level of a slab.
void find_extent(int slab, int first, int last, wp::array_t<LEVEL> found, wp::array_t<int> parts) {
    const LEVEL* from = found.data;
    LEVEL least = from[first], most = from[first];
    for (size_t i = first; i < last; ++i) {
        least = least < from[i] ? least : from[i];
        most = most > from[i] ? most : from[i];
    }
    parts.data[2 * slab] = least;
    parts.data[2 * slab + 1] = most;
}

// needs LEVEL, BYTES
// The histograms of a slab of tiles: of bytes themselves first, or else of bins.
void count_tiles(int slab, int first, int last, wp::array_t<LEVEL> found, wp::array_t<int> bins,
                 wp::array_t<int> rows, wp::array_t<int> columns, wp::array_t<int> parts,
                 wp::array_t<int> counts) {
    const size_t length = counts.shape[2], step = parts.shape[2];
    const int tall = counts.shape[0], wide = counts.shape[1];
    const int height = rows.shape[0] / tall, width = columns.shape[0] / wide;
    const int* bin = bins.data;
    const auto place = [=](LEVEL v) { return (size_t)(BYTES ? v : bin[v]); };
    int* __restrict__ own = parts.data + (size_t)slab * 4 * step;
    for (int tile = first; tile < last; ++tile) {
        const int top = tile / wide * height, left = tile % wide * width;
        for (size_t i = 0; i < 4 * step; ++i) own[i] = 0;
        for (int y = top; y < top + height; ++y) {
            const LEVEL* row = found.data + (size_t)rows.data[y] * found.shape[1];
            int x = left;
            const int right = left + width;
            const int within = right < found.shape[1] ? right : found.shape[1];
            for (; x + 8 <= within; x += 8)
#pragma clang loop unroll(full)
                for (int k = 0; k < 8; ++k) ++own[k % 4 * step + place(row[x + k])];
            for (; x < right; ++x) ++own[place(row[columns.data[x]])];
        }
        int* to = counts.data + tile * length;
        for (size_t i = 0; i < length; ++i) to[i] = 0;
        for (size_t i = 0; i < step; ++i)
            to[BYTES ? bin[i] : i] +=
                (own[i] + own[step + i]) + (own[2 * step + i] + own[3 * step + i]);
    }
}

// needs LEVEL, BYTES, TONES, PART
// The tones of a slab of rows, PART pixels at once, all between the middles of the same tiles. The
// tones that four tiles map a byte or a bin to are laid side by side.
void blend_rows(int slab, int first, int last, wp::array_t<LEVEL> found, wp::array_t<int> bins,
                wp::array_t<int> maps, wp::array_t<wp::float64> shares, int height,
                wp::array_t<int> quads, wp::array_t<wp::float64> weights,
                wp::array_t<wp::uint16> mixed) {
#pragma clang fp contract(off)
    typedef int ints __attribute__((vector_size(16), aligned(4), may_alias));
    typedef double doubles __attribute__((vector_size(32), aligned(8), may_alias));
    typedef double pair __attribute__((vector_size(64), aligned(8), may_alias));
    typedef float floats __attribute__((vector_size(64), aligned(4), may_alias));
    typedef float halves __attribute__((vector_size(32), aligned(4), may_alias));
    typedef int whole __attribute__((vector_size(64), aligned(4), may_alias));
    typedef wp::uint16 words __attribute__((vector_size(32), aligned(2), may_alias));
    // A parameter of 64 bytes allows the registers of 64 bytes in this function.
    const auto times = [](pair a, pair b) __attribute__((always_inline)) { return a * b; };
    const int columns = found.shape[1], width = shares.shape[0] - height;
    const int tall = maps.shape[0], wide = maps.shape[1];
    const size_t length = maps.shape[2], step = BYTES ? 256 : length;
    const int* bin = bins.data;
    ints* own = (ints*)(quads.data + (size_t)slab * quads.shape[1]);
    doubles* across = (doubles*)(weights.data + (size_t)slab * weights.shape[1]);
    for (int i = 0; i < width; ++i) {
        const double u = shares.data[height + i];
        across[i] = (doubles){1.0 - u, u, 1.0 - u, u};
    }
    float parts[4 * PART];
    doubles* product = across + width;  // weights of the four tiles in a row
    int ready = -1;
    for (int y = first; y < last; ++y) {
        const int py = y + height / 2, below = py / height;
        if (ready != below) {
            const int top = below > 0 ? below - 1 : 0, bottom = below < tall ? below : tall - 1;
            const int* upper = maps.data + (size_t)top * wide * length;
            const int* lower = maps.data + (size_t)bottom * wide * length;
            for (int after = 0; after <= wide; ++after) {
                const size_t left = (after > 0 ? after - 1 : 0) * length;
                const size_t right = (after < wide ? after : wide - 1) * length;
                ints* to = own + after * step;
                for (size_t i = 0; i < step; ++i) {
                    const size_t k = BYTES ? bin[i] : i;
                    to[i] = (ints){upper[left + k], upper[right + k], lower[left + k],
                                   lower[right + k]};
                }
            }
            ready = below;
        }
        const double v = shares.data[py % height];
        const doubles down = {1.0 - v, 1.0 - v, v, v};
        for (int i = 0; i < width; ++i) product[i] = across[i] * down;
        const LEVEL* row = found.data + (size_t)y * columns;
        wp::uint16* out = mixed.data + (size_t)y * columns;
        for (int x = 0; x < columns;) {
            const int px = x + width / 2;
            const ints* here = own + px / width * step;
            const doubles* weight = product + px % width;
            int count = width - px % width;
            count = count < columns - x ? count : columns - x;
            count = count < PART ? count : PART;
            const auto tones = [=](int i) { return here[BYTES ? row[x + i] : bin[row[x + i]]]; };
            for (int i = 0; i < count; i += 2) {
                const int next = i + 1 < count ? 1 : 0;
                const auto two =
                    __builtin_shufflevector(tones(i), tones(i + next), 0, 1, 2, 3, 4, 5, 6, 7);
                const pair weights =
                    __builtin_shufflevector(weight[i], weight[i + next], 0, 1, 2, 3, 4, 5, 6, 7);
                *(halves*)(parts + 4 * i) = __builtin_convertvector(
                    times(__builtin_convertvector(two, pair), weights), halves);
            }
            int i = 0;
            for (; i + 16 <= count; i += 16) {
                // Bring the four parts of 16 pixels to four vectors.
                const floats* part = (const floats*)(parts + 4 * i);
                const auto early = [&](int k) {
                    return __builtin_shufflevector(part[k], part[k + 1], 0, 4, 8, 12, 16, 20, 24,
                                                   28, 1, 5, 9, 13, 17, 21, 25, 29);
                };
                const auto late = [&](int k) {
                    return __builtin_shufflevector(part[k], part[k + 1], 2, 6, 10, 14, 18, 22, 26,
                                                   30, 3, 7, 11, 15, 19, 23, 27, 31);
                };
                const auto upper = [](floats a, floats b) {
                    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20,
                                                   21, 22, 23);
                };
                const auto lower = [](floats a, floats b) {
                    return __builtin_shufflevector(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26,
                                                   27, 28, 29, 30, 31);
                };
                const floats a = early(0), b = early(2), c = late(0), d = late(2);
                const floats sum = ((upper(a, b) + lower(a, b)) + upper(c, d)) + lower(c, d);
                const whole tone = __builtin_convertvector(sum, whole);
                *(words*)(out + x + i) =
                    __builtin_convertvector(tone < TONES - 1 ? tone : TONES - 1, words);
            }
            for (; i < count; ++i) {
                const float* part = parts + 4 * i;
                const int tone = (int)(((part[0] + part[1]) + part[2]) + part[3]);
                out[x + i] = (wp::uint16)(tone < TONES - 1 ? tone : TONES - 1);
            }
            x += count;
        }
    }
}

// needs LEVEL, BITS
// What a table has for the pixels of a slab: BITS, which are stored twice as fast as floats.
void read_table(int slab, int first, int last, wp::array_t<LEVEL> found, wp::array_t<BITS> table,
                wp::array_t<BITS> out) {
    const LEVEL* __restrict__ from = found.data;
    const BITS* __restrict__ values = table.data;
    BITS* __restrict__ to = out.data;
    size_t i = first;
#if defined(__AVX512VBMI__)
    // One instruction reads 64 bytes of a table of 128.
    typedef signed char Bytes __attribute__((vector_size(64)));
    const auto choose = [](const void* half, Bytes at) __attribute__((always_inline)) {
        Bytes low, high;
        __builtin_memcpy(&low, half, sizeof low);
        __builtin_memcpy(&high, (const char*)half + 64, sizeof high);
        return (Bytes)__builtin_ia32_vpermi2varqi512((__attribute__((vector_size(64))) char)low,
                                                     (__attribute__((vector_size(64))) char)at,
                                                     (__attribute__((vector_size(64))) char)high);
    };
    for (; sizeof(LEVEL) + sizeof(BITS) == 2 && i + 64 <= last; i += 64) {
        Bytes at;
        __builtin_memcpy(&at, from + i, sizeof at);
        const Bytes made = at < 0 ? choose(values + 128, at) : choose(values, at);
        __builtin_memcpy(to + i, &made, sizeof made);
    }
    typedef int Sixteen __attribute__((vector_size(64)));
    typedef LEVEL Levels __attribute__((vector_size(16 * sizeof(LEVEL))));
    const auto gather = [=](Sixteen at) __attribute__((always_inline)) {
        return (Sixteen)__builtin_ia32_gathersiv16si((Sixteen){}, values, at, 0xffff, 4);
    };
    for (; sizeof(BITS) == 4 && i + 16 <= last; i += 16) {
        Levels at;
        __builtin_memcpy(&at, from + i, sizeof at);
        const Sixteen made = gather(__builtin_convertvector(at, Sixteen));
        __builtin_memcpy((void*)(to + i), &made, sizeof made);
    }
#endif
#pragma clang loop unroll_count(8)
    for (; i < last; ++i) to[i] = values[from[i]];
}

// needs TYPE, OUT, WHOLE
// The colours of a slab of pixels, scaled so that the largest channel is what the table has.
void scale_colours(int slab, int first, int last, wp::array_t<TYPE> image,
                   wp::array_t<wp::uint16> found, wp::array_t<float> table, wp::array_t<OUT> out) {
#pragma clang fp contract(off)
    const TYPE* __restrict__ from = image.data;
    OUT* __restrict__ to = out.data;
    const auto scaled = [](float v, float value, float most) {
        const float result = most > 0.0f ? v * value / most : value;
        // Below 2^23 the sum drops the fraction: the nearest integer, and of two the even one.
        return WHOLE ? (OUT)(int)((result + 8388608.0f) - 8388608.0f) : (OUT)result;
    };
    for (size_t i = first; i < last; ++i) {
        const float r = (float)from[3 * i], g = (float)from[3 * i + 1], b = (float)from[3 * i + 2];
        const float wide = r > g ? r : g, most = wide > b ? wide : b;
        const float value = table.data[found.data[i]];
        to[3 * i] = scaled(r, value, most);
        to[3 * i + 1] = scaled(g, value, most);
        to[3 * i + 2] = scaled(b, value, most);
    }
}
