// needs THREADS, ONE, DEEPEST
// Move a maximum to a mode by mean shift, a block a maximum; modes.py has the rule.
//
// The kernel ONE - ONE d^2 / r^2 - deep of a vote, quotients rounded down, is above 0 if d^2 is
// below (ONE - deep) r^2 / ONE, rounded up. That limit depends on the distance in scale alone.
void shift(Cells cells, int radius, int scales, int rounds, wp::array_t<int> maxima,
           wp::array_t<int> modes) {
    typedef long long longs;
    __shared__ int limit[DEEPEST + 1], deep[DEEPEST + 1];
    __shared__ unsigned long long sums[4];
    const int t = blockIdx.x, thread = threadIdx.x;
    int y = maxima.data[4 * t], x = maxima.data[4 * t + 1], z = maxima.data[4 * t + 2];
    const int bins = cells.bins.shape[0], size = cells.factors.shape[0];
    const int listed = cells.votes.shape[0];
    // Add up the weights and the weighted distances of the votes, or at last the weighted kernel.
    const auto add = [&](bool last) {
        const int at = z - cells.lowest;
        const longs factor = cells.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
        const longs reach = (radius * factor + (1 << 15)) >> 16;
        const double area = (double)(reach * reach);
        __syncthreads();
        for (int k = thread; k <= scales; k += THREADS) {
            deep[k] = ONE * k * k / (scales * scales);
            limit[k] = (int)(((ONE - deep[k]) * reach * reach + ONE - 1) / ONE);
        }
        if (thread < 4) sums[thread] = 0;
        __syncthreads();
        longs own[4] = {0, 0, 0, 0};
        for (int s = 0; s < bins; ++s) {
            const int* bin = cells.bins.data + 5 * s;
            if (abs(bin[3] - z) > scales + cells.slack) continue;
            const int side = bin[4], columns = bin[2], span = (int)reach;
            const int top = max(y - span, 0) / side, before = min(max(x - span, 0) / side, columns);
            const int bottom = y + span < 0 ? 0 : min((y + span) / side + 1, bin[1]);
            const int right = x + span < 0 ? 0 : min((x + span) / side + 1, columns);
            const int behind = max(right, before);
            for (int row = top; row < bottom; ++row) {
                const int* cell = cells.starts.data + bin[0] + row * columns;
                const int end = min(cell[behind], listed);
                for (int v = cell[before] + thread; v < end; v += THREADS) {
                    const int4 vote = __ldg((const int4*)cells.votes.data + v);
                    const int dy = vote.x - y, dx = vote.y - x, dz = vote.z - z;
                    const int square = dy * dy + dx * dx, apart = abs(dz);
                    if (apart > scales || square >= limit[apart]) continue;
                    const longs weight = vote.w;
                    if (last) {
                        const int flat = (int)((double)square * ONE / area);
                        own[0] += weight * (ONE - deep[apart] - flat);
                    } else {
                        own[0] += weight, own[1] += weight * dy;
                        own[2] += weight * dx, own[3] += weight * dz;
                    }
                }
            }
        }
        for (int k = 0; k < (last ? 1 : 4); ++k) {
            longs sum = own[k];
            for (int apart = 16; apart; apart /= 2) sum += __shfl_xor_sync(~0u, sum, apart);
            if (thread % 32 == 0) atomicAdd(sums + k, (unsigned long long)sum);
        }
        __syncthreads();
    };
    longs density = 0;
    if (maxima.data[4 * t + 3] > 0) {
        for (int round = 0; round < rounds; ++round) {
            add(false);
            const longs mass = sums[0];
            if (!mass) break;
            const auto mean = [&](longs sum) { return (int)((2 * sum + mass) / (2 * mass)); };
            const int row = mean((longs)sums[1] + y * mass),
                      column = mean((longs)sums[2] + x * mass);
            const int scale = mean((longs)sums[3] + (z - cells.lowest) * mass) + cells.lowest;
            if (row == y && column == x && scale == z) break;
            y = row, x = column, z = scale;
        }
        add(true);
        density = sums[0];
    }
    if (thread) return;
    int* mode = modes.data + 4 * t;
    mode[0] = y, mode[1] = x, mode[2] = z, mode[3] = (int)(density / ONE);
}

// needs LANES
// Count or list the votes of a word of a patch, by several lanes; votes.py has the rule.
//
// When votes are counted, `cells` (C,) get their number in the upper half, and the sum of weights in
// the lower. When they are listed, they have the place of the next vote of each cell.
void cast(Ballot ballot, wp::array_t<wp::uint64> cells, wp::array_t<int> votes) {
    const int item = (blockIdx.x * blockDim.x + threadIdx.x) / LANES, lane = threadIdx.x % LANES;
    const int most = ballot.matches.shape[1], i = item / most;
    if (i >= ballot.matches.shape[0]) return;
    const int* match = ballot.matches.data + (size_t)i * most;
    const int word = match[item - i * most];
    if (word < 0) return;
    int active = 0;
    for (int m = 0; m < most; ++m) active += match[m] >= 0;
    const int* place = ballot.places.data + 3 * (size_t)i;
    const int y = place[0], x = place[1], z = place[2];
    const int at = z - ballot.lowest, size = ballot.factors.shape[0];
    const long long factor = ballot.factors.data[at < 0 ? 0 : at < size ? at : size - 1];
    const int end = ballot.begins.data[word + 1];
    for (int e = ballot.begins.data[word] + lane; e < end; e += LANES) {
        const int4 entry = __ldg((const int4*)ballot.entries.data + e);
        const int scale = z + entry.z;
        int s = -1, least = ballot.slack + 1;
        for (int k = 0; k < ballot.bins.shape[0]; ++k) {
            const int apart = abs(scale - ballot.bins.data[5 * k + 3]);
            if (apart < least) least = apart, s = k;
        }
        if (s < 0) continue;
        const int* bin = ballot.bins.data + 5 * s;
        const int down = y + (int)((entry.x * factor + (1 << 15)) >> 16);
        const int along = x + (int)((entry.y * factor + (1 << 15)) >> 16);
        if (down < 0 || along < 0) continue;
        const int row = down / bin[4], column = along / bin[4];
        if (row >= bin[1] || column >= bin[2]) continue;
        const int c = bin[0] + row * bin[2] + column, weight = entry.w / active;
        if (!ballot.listing) {
            atomicAdd((unsigned long long*)cells.data + c, (1ull << 32) + (unsigned int)weight);
        } else if (ballot.starts.data[c + 1] > ballot.starts.data[c] &&
                   ballot.starts.data[c + 1] <= votes.shape[0]) {
            const size_t to = atomicAdd((unsigned long long*)cells.data + c, 1ull);
            ((int4*)votes.data)[ballot.starts.data[c] + to] = make_int4(down, along, scale, weight);
        }
    }
}

// needs THREADS, NOBODY
// List the largest maxima in their order, in one block; modes.py has the rule.
//
// Bisection finds the largest value that enough maxima have. Each thread then lists a part of them.
void select(wp::array_t<int> maxima, wp::array_t<int> highest) {
    __shared__ int above[THREADS], equal[THREADS], sums[THREADS / 32], all;
    const int count = maxima.shape[0], most = highest.shape[0], thread = threadIdx.x;
    const int begin = (int)((long long)count * thread / THREADS);
    const int end = (int)((long long)count * (thread + 1) / THREADS);
    const auto value = [&](int t) { return maxima.data[4 * (size_t)t + 3]; };
    const auto together = [&](int own, bool largest) {
        for (int apart = 16; apart; apart /= 2) {
            const int other = __shfl_xor_sync(~0u, own, apart);
            own = largest ? max(own, other) : own + other;
        }
        __syncthreads();
        if (thread % 32 == 0) sums[thread / 32] = own;
        __syncthreads();
        if (thread < 32) {
            own = thread < THREADS / 32 ? sums[thread] : 0;
            for (int apart = 16; apart; apart /= 2) {
                const int other = __shfl_xor_sync(~0u, own, apart);
                own = largest ? max(own, other) : own + other;
            }
            if (thread == 0) all = own;
        }
        __syncthreads();
        return all;
    };
    int least = 1, own = 0;
    for (int t = begin; t < end; ++t) own = max(own, value(t));
    int top = together(own, true);
    while (least < top) {
        const int middle = least + (top - least) / 2 + 1;
        int there = 0;
        for (int t = begin; t < end; ++t) there += value(t) >= middle;
        if (together(there, false) >= most)
            least = middle;
        else
            top = middle - 1;
    }
    int more = 0, same = 0;
    for (int t = begin; t < end; ++t) more += value(t) > least, same += value(t) == least;
    above[thread] = more, equal[thread] = same;
    for (int apart = 1; apart < THREADS; apart *= 2) {
        __syncthreads();
        const int a = thread >= apart ? above[thread - apart] : 0;
        const int b = thread >= apart ? equal[thread - apart] : 0;
        __syncthreads();
        above[thread] += a, equal[thread] += b;
    }
    __syncthreads();
    const int room = most - above[THREADS - 1];
    int before = above[thread] - more, alike = equal[thread] - same;
    const auto list = [&](int t) {
        const int to = before + min(alike, room);
        for (int k = 0; k < 4; ++k) highest.data[4 * to + k] = maxima.data[4 * (size_t)t + k];
    };
    for (int t = begin; t < end; ++t) {
        if (value(t) > least) list(t), ++before;
        if (value(t) == least) {
            if (alike < room) list(t);
            ++alike;
        }
    }
    const int listed = above[THREADS - 1] + min(equal[THREADS - 1], room);
    for (int i = 4 * listed + thread; i < 4 * most; i += THREADS) highest.data[i] = NOBODY;
}
