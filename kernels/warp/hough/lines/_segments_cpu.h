// needs MOST_TILES SIDE
// Sort the points by tiles, which are squares in raster order, at most MOST_TILES + 1 along a side.
void sort_points(int slab, int first, int last, wp::array_t<float> points, Tiles tiles,
                 wp::array_t<int> places) {
#pragma clang fp contract(off)
    const int number = points.shape[0];
    const float* place = points.data;
    float tallest = 0.0f, widest = 0.0f;
    for (int i = 0; i < number; ++i) {
        tallest = place[2 * i] > tallest ? place[2 * i] : tallest;
        widest = place[2 * i + 1] > widest ? place[2 * i + 1] : widest;
    }
    const int longest = (int)(tallest > widest ? tallest : widest) + 1;
    const int least = (longest + MOST_TILES - 1) / MOST_TILES;
    const int side = least > SIDE ? least : SIDE;
    const float each = 1.0f / (float)side;
    const int across = (int)(widest * each) + 1, count = across * ((int)(tallest * each) + 1);
    int* begin = tiles.starts.data;
    for (int tile = 0; tile <= count; ++tile) begin[tile] = 0;
    // Conversion to integers rounds towards 0, so points just outside belong to the first tiles.
    for (int i = 0; i < number; ++i)
        places.data[i] = (int)(place[2 * i] * each) * across + (int)(place[2 * i + 1] * each);
    for (int i = 0; i < number; ++i) ++begin[places.data[i]];
    for (int tile = 0, before = 0; tile <= count; ++tile) {
        const int here = begin[tile];
        begin[tile] = before;
        before += here;
    }
    for (int i = 0; i < number; ++i) tiles.order.data[begin[places.data[i]]++] = i;
    for (int tile = count; tile > 0; --tile) begin[tile] = begin[tile - 1];
    begin[0] = 0;
    tiles.frame.data[0] = side;
    tiles.frame.data[1] = across;
    tiles.frame.data[2] = count;
}

// needs LANES SECTORS COLUMNS HALF_TURN
// A slab has the tiles whose first sorted point is between `first` and `last`. A tile has a list of
// the lines that pass near its middle for each sector of directions, strongest line first. A list
// consists of blocks: cosine, sine, rho, direction and number of LANES lines. A point is tested
// against one block of its sector after the other, until it is on a line.
void claim(int slab, int first, int last, wp::array_t<float> points, wp::array_t<int> codes,
           wp::array_t<int> after, wp::array_t<float> lines, wp::array_t<int> directions,
           float distance, int tolerance, Tiles tiles, wp::array_t<int> labels) {
#pragma clang fp contract(off)
    const int count = lines.shape[1], sector_codes = HALF_TURN / SECTORS;
    const float *cosine = lines.data, *sine = cosine + count, *rho = sine + count;
    const int *frame = tiles.frame.data, side = frame[0], across = frame[1], squares = frame[2];
    // Half a diagonal, and two pixels because points of the outermost tiles may lie outside them.
    const float reach = distance + 0.7072f * (float)side + 2.0f;
    const int span = 2 * tolerance + 1 < HALF_TURN ? 2 * tolerance : HALF_TURN - 1;
    float* lists[SECTORS];
    for (int s = 0; s < SECTORS; ++s)
        lists[s] = tiles.near.data + ((size_t)slab * SECTORS + s) * tiles.near.shape[2];
    for (int tile = 0; tile < squares; ++tile) {
        const int begin = tiles.starts.data[tile], end = tiles.starts.data[tile + 1];
        if (begin == end || begin < first || begin >= last) continue;
        const float middle_y = ((float)(tile / across) + 0.5f) * (float)side;
        const float middle_x = ((float)(tile % across) + 0.5f) * (float)side;
        int number[SECTORS] = {};
        const auto place = [&](int sector) {
            const int n = number[sector]++;
            return lists[sector] + n / LANES * (COLUMNS * LANES) + n % LANES;
        };
        const auto list = [&](int k) {
            const int direction = directions.data[k];
            const int from = (direction - tolerance) & (HALF_TURN - 1);
            int sectors = ((from & (sector_codes - 1)) + span) / sector_codes + 1;
            sectors = sectors < SECTORS ? sectors : SECTORS;
            const float c = cosine[k], s = sine[k], r = rho[k];
            for (int i = from / sector_codes; i < from / sector_codes + sectors; ++i) {
                float* entry = place(i & (SECTORS - 1));
                entry[0] = c;
                entry[LANES] = s;
                entry[2 * LANES] = r;
                ((int*)entry)[3 * LANES] = direction;
                ((int*)entry)[4 * LANES] = k;
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
            while (number[sector] % LANES) {  // lines that no point is on
                float* entry = place(sector);
                for (int i = 0; i < 4; ++i) entry[i * LANES] = 0.0f;
                ((int*)entry)[4 * LANES] = count;
            }
        for (int i = begin; i < end; ++i) {
            const int point = tiles.order.data[i], past = after.data[point],
                      code = codes.data[point];
            const float y = points.data[2 * point], x = points.data[2 * point + 1];
            const int sector = (code & (HALF_TURN - 1)) / sector_codes;
            const float *block = lists[sector], *stop = block + number[sector] * COLUMNS;
            int label = count;
            for (; block < stop && label == count; block += COLUMNS * LANES) {
                const int* integers = (const int*)block + 3 * LANES;
                if (integers[2 * LANES - 1] <= past) continue;
                for (int k = 0; k < LANES; ++k) {
                    const float along = x * block[k] + y * block[LANES + k];
                    const float away = __builtin_fabsf(along - block[2 * LANES + k]);
                    const int turn = (code - integers[k]) & (HALF_TURN - 1);
                    const int angle = turn < HALF_TURN - turn ? turn : HALF_TURN - turn;
                    const int line = integers[LANES + k];
                    const bool on = (away <= distance) & (angle <= tolerance) & (line > past);
                    const int mine = on ? line : count;
                    label = mine < label ? mine : label;
                }
            }
            labels.data[point] = label;
        }
    }
}
