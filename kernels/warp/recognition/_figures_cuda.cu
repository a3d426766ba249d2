// needs PARTS, LARGEST, ONE, APART, FINE
// Add up what the votes for a mode say of the pixels of its box; figures.py has the rule.
//
// A warp has every `PARTS`-th patch of a row for a mode. All votes of a patch have the same first
// pixel: lanes look at 32 votes at once, and then add up the masks of those that count, each lane
// every 32nd pixel.
void paint(Ballot ballot, Painter by, wp::array_t<wp::uint8> figures, wp::array_t<int> modes,
           wp::array_t<int> balance) {
    typedef long long longs;
    enum { EACH = (LARGEST + 31) / 32 };
    const int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    const int part = item % PARTS, rows = ballot.rows.shape[0];
    const int line = item / PARTS % rows, t = item / PARTS / rows;
    if (t >= balance.shape[0] || t >= modes.data[0]) return;
    const int* mode = modes.data + 4 * (t + 1);
    const int y = mode[0], x = mode[1], z = mode[2], side = by.side, pixels = side * side;
    const int height = balance.shape[1], width = balance.shape[2], most = ballot.matches.shape[1];
    const auto factor_at = [&](int scale) {
        const int at = scale - ballot.lowest, size = ballot.factors.shape[0];
        return (longs)ballot.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
    };
    const auto scaled = [](longs n, longs factor) { return (int)((n * factor + (1 << 15)) >> 16); };
    const int* row = ballot.rows.data + 3 * line;
    const int scale = ballot.places.data[3 * (size_t)row[1] + 2];
    if (abs(scale - z) >= APART) return;
    const longs own = factor_at(z), reach = scaled(by.radius, own), factor = factor_at(scale);
    if (abs(row[0] - y) > scaled(by.half_height, factor) + reach) return;
    const int along = scaled(by.half_width, factor) + (int)reach;
    // First pixel of a patch in the box, halves rounded up.
    const auto first = [&](int n, int extent) {
        const longs wide = (longs)n * 65536 + (1ll << 30) * own;
        const int at = (int)(wide / own - (1 << 30)) + FINE / 2 + FINE * (extent - side) / 2;
        return at >> 4;
    };
    int low = row[1], high = row[2];
    while (low < high) {
        const int middle = (low + high) / 2;
        if (ballot.places.data[3 * (size_t)middle + 1] < x - along)
            low = middle + 1;
        else
            high = middle;
    }
    for (int i = low + part; i < row[2]; i += PARTS) {
        const int* place = ballot.places.data + 3 * (size_t)i;
        if (place[1] > x + along) break;
        const int* match = ballot.matches.data + (size_t)i * most;
        int active = 0, sums[EACH];
        for (int m = 0; m < most; ++m) active += match[m] >= 0;
#pragma unroll
        for (int k = 0; k < EACH; ++k) sums[k] = 0;
        bool any = false;
        for (int m = 0; m < active; ++m) {
            const int end = ballot.begins.data[match[m] + 1];
            for (int from = ballot.begins.data[match[m]]; from < end; from += 32) {
                const int e = from + lane;
                int weight = 0, counts = 0;
                if (e < end) {
                    const int4 entry = __ldg((const int4*)ballot.entries.data + e);
                    const int down = place[0] + scaled(entry.x, factor);
                    const int across = place[1] + scaled(entry.y, factor);
                    const longs dy = down - y, dx = across - x, dz = scale + entry.z - z;
                    // Most votes are far away: find that without a division.
                    if (dy * dy + dx * dx < reach * reach && dz * dz < by.scales * by.scales &&
                        down >= 0 && across >= 0) {
                        const longs near = ONE - ONE * (dy * dy + dx * dx) / (reach * reach) -
                                           ONE * dz * dz / (by.scales * by.scales);
                        int s = -1, slack = ballot.slack + 1;
                        for (int k = 0; k < ballot.bins.shape[0]; ++k) {
                            const int apart = abs(scale + entry.z - ballot.bins.data[5 * k + 3]);
                            if (apart < slack) slack = apart, s = k;
                        }
                        const int* bin = ballot.bins.data + 5 * s;
                        counts = near > 0 && s >= 0 && down / bin[4] < bin[1] &&
                                 across / bin[4] < bin[2];
                        weight = (int)(entry.w / active * near / ONE);
                    }
                }
                for (unsigned int left = __ballot_sync(~0u, counts); left; left &= left - 1) {
                    const int vote = __ffs(left) - 1, by_vote = __shfl_sync(~0u, weight, vote);
                    const wp::uint8* share = figures.data + (size_t)(from + vote) * pixels;
                    any = true;
#pragma unroll
                    for (int k = 0; k < EACH; ++k)
                        if (32 * k + lane < pixels)
                            sums[k] += by_vote * (2 * (int)share[32 * k + lane] - 255) >> 8;
                }
            }
        }
        if (!any) continue;
        const int top = first(place[0] - y, height), left = first(place[1] - x, width);
        int* box = balance.data + (size_t)t * height * width;
#pragma unroll
        for (int k = 0; k < EACH; ++k) {
            const int down = top + (32 * k + lane) / side, over = left + (32 * k + lane) % side;
            if (32 * k + lane < pixels && down >= 0 && over >= 0 && down < height && over < width)
                atomicAdd(box + (size_t)down * width + over, sums[k]);
        }
    }
}
