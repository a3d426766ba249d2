// needs THREADS
// List the points of lowest rank, then of largest value, then the first ones: one block, which
// finds the last one to list byte by byte of rank and value. A value below 0 is no point.
void choose(wp::array_t<int> values, wp::array_t<int> ranks, int ranked, wp::array_t<int> number,
            wp::array_t<int> chosen) {
    typedef unsigned long long key_t;
    __shared__ int bins[256];
    __shared__ int parts[2][THREADS];
    __shared__ key_t largest, prefix;
    __shared__ int there, missing;
    const int thread = threadIdx.x, size = values.shape[0], most = chosen.shape[0];
    const auto key_of = [&](int i) {
        const key_t rank = ranked ? (unsigned)ranks.data[i] : 0u;
        return rank << 32 | (unsigned)(0x7fffffff - values.data[i]);
    };
    if (thread == 0) largest = 0, prefix = 0, there = 0, missing = most;
    __syncthreads();
    key_t top = 0;
    int count = 0;
    for (int i = thread; i < size; i += THREADS)
        if (values.data[i] >= 0) ++count, top = max(top, key_of(i));
    atomicAdd(&there, count);
    atomicMax(&largest, top);
    __syncthreads();
    const bool all = there <= most;
    // Afterwards all keys below `prefix` are listed, and the first `missing` of those equal to it.
    int shift = 56;
    while (shift > 0 && largest >> shift == 0) shift -= 8;
    for (; !all && shift >= 0; shift -= 8) {
        for (int b = thread; b < 256; b += THREADS) bins[b] = 0;
        __syncthreads();
        const key_t known = prefix;
        for (int i = thread; i < size; i += THREADS) {
            if (values.data[i] < 0) continue;
            const key_t key = key_of(i);
            // A shift by 64 would leave a number as it is.
            if (key >> shift >> 8 == known >> shift >> 8) atomicAdd(&bins[key >> shift & 255], 1);
        }
        __syncthreads();
        // A warp finds the byte up to which more than `missing` keys lie: a lane has eight bytes.
        if (thread < 32) {
            int own = 0;
            for (int b = 0; b < 8; ++b) own += bins[8 * thread + b];
            int before = own;
            for (int apart = 1; apart < 32; apart *= 2) {
                const int lower = __shfl_up_sync(~0u, before, apart);
                if (thread >= apart) before += lower;
            }
            before -= own;
            const unsigned reached = __ballot_sync(~0u, before + own >= missing);
            if (thread == (reached ? __ffs(reached) - 1 : 31)) {
                int b = 8 * thread, left = missing - before;
                while (b < 255 && bins[b] < left) left -= bins[b++];
                prefix = known | (key_t)b << shift, missing = left;
            }
        }
        __syncthreads();
    }
    const key_t last = prefix;
    const int equals = missing;
    const int run = (size + THREADS - 1) / THREADS;
    const int begin = min(thread * run, size), end = min(begin + run, size);
    int below = 0, equal = 0;
    for (int i = begin; i < end; ++i)
        if (values.data[i] >= 0) {
            const key_t key = all ? 0 : key_of(i);
            below += all || key < last, equal += !all && key == last;
        }
    parts[0][thread] = below, parts[1][thread] = equal;
    __syncthreads();
    for (int apart = 1; apart < THREADS; apart *= 2) {
        const int one = thread >= apart ? parts[0][thread - apart] : 0;
        const int other = thread >= apart ? parts[1][thread - apart] : 0;
        __syncthreads();
        parts[0][thread] += one, parts[1][thread] += other;
        __syncthreads();
    }
    int same = parts[1][thread] - equal;  // keys equal to the last one, before this thread's
    int at = parts[0][thread] - below + min(same, equals);
    for (int i = begin; i < end; ++i)
        if (values.data[i] >= 0) {
            const key_t key = all ? 0 : key_of(i);
            const bool kept = all || key < last || (key == last && same < equals);
            same += !all && key == last;
            if (kept) chosen.data[at++] = i;
        }
    if (thread == 0) number.data[0] = all ? there : most;
}
