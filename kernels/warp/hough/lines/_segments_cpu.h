// needs MOST_TILES SIDE SECTORS HALF_TURN
// Sort the points by tiles, which are squares in raster order, at most MOST_TILES + 1 along a side,
// and by sectors of half a turn. Points that are on the line after `after` have their label.
void sort_points(int slab, int first, int last, wp::array_t<float> points, wp::array_t<int> codes,
                 wp::array_t<int> after, wp::array_t<float> lines, wp::array_t<int> directions,
                 float distance, int tolerance, Tiles tiles, wp::array_t<int> labels) {
#pragma clang fp contract(off)
    const int number = points.shape[0];
    const float* place = points.data;
    // The order of floats that are not negative is that of their bits, which vector code compares.
    typedef int Bits __attribute__((may_alias));
    const Bits* bits = (const Bits*)place;
    int most[2] = {};
    for (int i = 0; i < number; ++i)
        for (int k = 0; k < 2; ++k) most[k] = bits[2 * i + k] > most[k] ? bits[2 * i + k] : most[k];
    float tallest, widest;
    __builtin_memcpy(&tallest, most, 4);
    __builtin_memcpy(&widest, most + 1, 4);
    const int longest = (int)(tallest > widest ? tallest : widest) + 1;
    const int least = (longest + MOST_TILES - 1) / MOST_TILES;
    const int side = least > SIDE ? least : SIDE;
    const float each = 1.0f / (float)side;
    const int across = (int)(widest * each) + 1, squares = across * ((int)(tallest * each) + 1);
    const int count = squares * SECTORS, all = lines.shape[1];
    int *begin = tiles.starts.data, *places = tiles.places.data;
    for (int k = 0; k <= count + 1; ++k) begin[k] = 0;
    // Conversion to integers rounds towards 0, so points just outside belong to the first tiles.
    for (int i = 0; i < number; ++i) {
        const float y = place[2 * i], x = place[2 * i + 1];
        const int code = codes.data[i], line = after.data[i] + 1;
        const int sector = (code & (HALF_TURN - 1)) / (HALF_TURN / SECTORS);
        places[i] = ((int)(y * each) * across + (int)(x * each)) * SECTORS + sector;
        const auto is_held = [&] {
            const float along = x * lines.data[line] + y * lines.data[all + line];
            const int turn = (code - directions.data[line] + tolerance) & (HALF_TURN - 1);
            return __builtin_fabsf(along - lines.data[2 * all + line]) <= distance &&
                   turn <= 2 * tolerance;
        };
        if (line > 0 && line < all && is_held()) {
            labels.data[i] = line;
            places[i] = count;
        }
        ++begin[places[i]];
    }
    for (int k = 0, before = 0; k <= count + 1; ++k) {
        const int here = begin[k];
        begin[k] = before;
        before += here;
    }
    for (int i = 0; i < number; ++i) tiles.order.data[begin[places[i]]++] = i;
    for (int k = count + 1; k > 0; --k) begin[k] = begin[k - 1];
    begin[0] = 0;
    tiles.frame.data[0] = side;
    tiles.frame.data[1] = across;
    tiles.frame.data[2] = squares;
}

// needs LINES POINTS SECTORS HALF_TURN
// A slab has the tiles whose first sorted point is between `first` and `last`. A tile has a list of
// the lines that pass near its middle for each sector of directions, strongest line first. The points
// of a sector are tested together against some lines at a time, and are left at their first line.
void claim(int slab, int first, int last, wp::array_t<float> points, wp::array_t<int> codes,
           wp::array_t<int> after, wp::array_t<float> lines, wp::array_t<int> directions,
           float distance, int tolerance, Tiles tiles, wp::array_t<int> labels) {
#pragma clang fp contract(off)
    typedef float Reals __attribute__((vector_size(64), aligned(4), may_alias));
    typedef int Ints __attribute__((vector_size(64), aligned(4), may_alias));
    const int count = lines.shape[1], sector_codes = HALF_TURN / SECTORS;
    const float *cosine = lines.data, *sine = cosine + count, *rho = sine + count;
    const int *frame = tiles.frame.data, side = frame[0], across = frame[1], squares = frame[2];
    // Half a diagonal, and two pixels because points of the outermost tiles may lie outside them.
    const float reach = distance + 0.7072f * (float)side + 2.0f;
    const int span = 2 * tolerance + 1 < HALF_TURN ? 2 * tolerance : HALF_TURN - 1;
    int* lists = tiles.near.data + (size_t)slab * SECTORS * count;
    float y[POINTS] = {}, x[POINTS] = {};
    int index[POINTS], code[POINTS] = {}, past[POINTS] = {}, found[16];
    // A parameter of 64 bytes allows the registers of 64 bytes in this function.
    const auto on = [&](Reals away, Ints turn, Ints past, int line) __attribute__((always_inline)) {
        return (away <= distance) & (away >= -distance) & (turn <= span) & (past < line);
    };
    for (int tile = 0; tile < squares; ++tile) {
        const int* starts = tiles.starts.data + tile * SECTORS;
        if (starts[0] == starts[SECTORS] || starts[0] < first || starts[0] >= last) continue;
        const float middle_y = ((float)(tile / across) + 0.5f) * (float)side;
        const float middle_x = ((float)(tile % across) + 0.5f) * (float)side;
        int number[SECTORS] = {};
        const auto list = [&](int k) {
            const int from = (directions.data[k] - tolerance) & (HALF_TURN - 1);
            int sectors = ((from & (sector_codes - 1)) + span) / sector_codes + 1;
            sectors = sectors < SECTORS ? sectors : SECTORS;
            for (int i = from / sector_codes; sectors--; ++i) {
                const int sector = i & (SECTORS - 1);
                lists[sector * count + number[sector]++] = k;
            }
        };
        for (int k = 0; k < count; k += 64) {
            const int some = count - k < 64 ? count - k : 64;
            unsigned char passes[64] = {};
            const auto test = [&](int size) __attribute__((always_inline)) {
#pragma clang loop vectorize(assume_safety)
                for (int i = 0; i < size; ++i) {
                    const float away = middle_x * cosine[k + i] + middle_y * sine[k + i];
                    passes[i] = __builtin_fabsf(away - rho[k + i]) <= reach;
                }
            };
            if (some == 64)
                test(64);
            else
                test(some);
            for (int i = 0; i < 64; i += 8) {
                unsigned long long eight;
                __builtin_memcpy(&eight, passes + i, 8);
                for (; eight; eight &= eight - 1) list(k + i + __builtin_ctzll(eight) / 8);
            }
        }
        for (int sector = 0; sector < SECTORS; ++sector)
            for (int begin = starts[sector]; begin < starts[sector + 1]; begin += POINTS) {
                const int rest = starts[sector + 1] - begin, *near = lists + sector * count;
                int left = rest < POINTS ? rest : POINTS;
                for (int i = 0; i < left; ++i) {
                    const int point = tiles.order.data[begin + i];
                    index[i] = point;
                    y[i] = points.data[2 * point];
                    x[i] = points.data[2 * point + 1];
                    code[i] = codes.data[point] + tolerance;
                    past[i] = after.data[point];
                    labels.data[point] = count;
                }
                for (int n = 0; n < number[sector] && left; n += LINES) {
                    const int end = number[sector] - n < LINES ? number[sector] : n + LINES;
                    int kept = 0;
                    for (int i = 0; i < left; i += 16) {
                        const Reals down = *(const Reals*)(y + i), along = *(const Reals*)(x + i);
                        const Ints turned = *(const Ints*)(code + i),
                                   before = *(const Ints*)(past + i);
                        Ints label = Ints{} + count;
                        for (int j = end - 1; j >= n; --j) {
                            const int k = near[j];
                            const Reals away = along * cosine[k] + down * sine[k] - rho[k];
                            const Ints turn = (turned - directions.data[k]) & (HALF_TURN - 1);
                            label = on(away, turn, before, k) ? Ints{} + k : label;
                        }
                        *(Ints*)found = label;
                        // Points that are on no line yet move together.
                        for (int j = i; j < i + 16 && j < left; ++j) {
                            labels.data[index[j]] = found[j - i];
                            index[kept] = index[j];
                            y[kept] = y[j];
                            x[kept] = x[j];
                            code[kept] = code[j];
                            past[kept] = past[j];
                            kept += found[j - i] == count;
                        }
                    }
                    left = kept;
                }
            }
    }
}
