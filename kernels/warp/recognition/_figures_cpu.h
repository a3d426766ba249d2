// needs LANES, LARGEST, ONE, APART, FINE
// Add up what the votes for a mode say of the pixels of its box; figures.py has the rule.
//
// All votes of a patch have the same first pixel: their masks are added up first, 16 pixels at once.
void paint_mode(int t, Ballot ballot, Painter by, wp::array_t<wp::uint8> figures,
                wp::array_t<int> modes, wp::array_t<int> balance) {
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    typedef unsigned char bytes __attribute__((vector_size(LANES)));
    if (t >= modes.data[0]) return;
    const int* mode = modes.data + 4 * (t + 1);
    const int y = mode[0], x = mode[1], z = mode[2], side = by.side, pixels = side * side;
    const int height = balance.shape[1], width = balance.shape[2], most = ballot.matches.shape[1];
    int* box = balance.data + (size_t)t * height * width;
    const auto factor_at = [&](int scale) {
        const int at = scale - ballot.lowest, size = ballot.factors.shape[0];
        return (wp::int64)ballot.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
    };
    const auto scaled = [](wp::int64 n, wp::int64 factor) {
        return (int)((n * factor + (1 << 15)) >> 16);
    };
    const wp::int64 own = factor_at(z), reach = scaled(by.radius, own);
    // First pixel of a patch in the box, halves rounded up.
    const auto first = [&](int n, int extent) {
        const wp::int64 wide = (wp::int64)n * 65536 + (1ll << 30) * own;
        const int at = (int)(wide / own - (1 << 30)) + FINE / 2 + FINE * (extent - side) / 2;
        return at >> 4;
    };
    for (int level = 0; level < ballot.levels.shape[0]; ++level) {
        const int* l = ballot.levels.data + 3 * level;
        if (__builtin_abs(l[0] - z) >= APART) continue;
        const wp::int64 factor = factor_at(l[0]);
        const int down = scaled(by.half_height, factor) + (int)reach;
        const int along = scaled(by.half_width, factor) + (int)reach;
        for (int line = l[1]; line < l[2]; ++line) {
            const int* row = ballot.rows.data + 3 * line;
            if (__builtin_abs(row[0] - y) > down) continue;
            for (int i = row[1]; i < row[2]; ++i) {
                const int* place = ballot.places.data + 3 * (size_t)i;
                const int* match = ballot.matches.data + (size_t)i * most;
                if (__builtin_abs(place[1] - x) > along) continue;
                int active = 0;
                for (int m = 0; m < most; ++m) active += match[m] >= 0;
                alignas(64) int sums[LARGEST + LANES];
                bool any = false;
                for (int m = 0; m < active; ++m) {
                    const int end = ballot.begins.data[match[m] + 1];
                    for (int e = ballot.begins.data[match[m]]; e < end; ++e) {
                        const int* entry = ballot.entries.data + 4 * (size_t)e;
                        const int down = place[0] + scaled(entry[0], factor);
                        const int along = place[1] + scaled(entry[1], factor);
                        const wp::int64 dy = down - y, dx = along - x, dz = l[0] + entry[2] - z;
                        // Most votes are far away: find that without a division.
                        if (dy * dy + dx * dx >= reach * reach || dz * dz >= by.scales * by.scales)
                            continue;
                        const wp::int64 near = ONE - ONE * (dy * dy + dx * dx) / (reach * reach) -
                                               ONE * dz * dz / (by.scales * by.scales);
                        if (near <= 0 || down < 0 || along < 0) continue;
                        int s = -1, slack = ballot.slack + 1;
                        for (int k = 0; k < ballot.bins.shape[0]; ++k) {
                            const int apart =
                                __builtin_abs(l[0] + entry[2] - ballot.bins.data[5 * k + 3]);
                            if (apart < slack) slack = apart, s = k;
                        }
                        if (s < 0) continue;
                        const int* bin = ballot.bins.data + 5 * s;
                        if (down / bin[4] >= bin[1] || along / bin[4] >= bin[2]) continue;
                        const int weight = (int)(entry[3] / active * near / ONE);
                        if (!any)
                            for (int k = 0; k < pixels + LANES; ++k) sums[k] = 0;
                        any = true;
                        const unsigned char* share = figures.data + (size_t)e * pixels;
                        int k = 0;
                        for (; k + LANES <= pixels; k += LANES) {
                            bytes value;
                            __builtin_memcpy(&value, share + k, sizeof value);
                            const lanes two = 2 * __builtin_convertvector(value, lanes) - 255;
                            *(lanes*)(sums + k) += weight * two >> 8;
                        }
                        for (; k < pixels; ++k) sums[k] += weight * (2 * share[k] - 255) >> 8;
                    }
                }
                if (!any) continue;
                const int top = first(place[0] - y, height), left = first(place[1] - x, width);
                for (int r = top < 0 ? -top : 0; r < side && top + r < height; ++r)
                    for (int c = left < 0 ? -left : 0; c < side && left + c < width; ++c)
                        box[(size_t)(top + r) * width + left + c] += sums[r * side + c];
            }
        }
    }
}
