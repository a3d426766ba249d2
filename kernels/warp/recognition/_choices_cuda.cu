// needs THREADS
// Choose hypotheses in one block, a thread each; choices.py has the rule.
void explain(wp::array_t<int> ranked, wp::array_t<int> savings, wp::array_t<int> shared,
             wp::array_t<int> starts, int least, wp::array_t<int> found) {
    typedef long long longs;
    __shared__ longs tops[THREADS / 32], top;
    const int i = threadIdx.x, count = ranked.shape[0];
    const bool is_there = i < count && ranked.data[4 * i + 3] > 0;
    const longs lowest = -(1ll << 62);
    // The key of what is left is larger for the first one in a tie.
    longs left = is_there ? savings.data[i] : 0;
    int chosen = 0;
    for (;; ++chosen) {
        longs key = is_there && left >= least ? left * THREADS + (THREADS - 1 - i) : lowest;
        for (int apart = 16; apart; apart /= 2) {
            const longs other = __shfl_xor_sync(~0u, key, apart);
            key = other > key ? other : key;
        }
        if (i % 32 == 0) tops[i / 32] = key;
        __syncthreads();
        if (i == 0) {
            top = tops[0];
            for (int w = 1; w < THREADS / 32; ++w) top = tops[w] > top ? tops[w] : top;
        }
        __syncthreads();
        const longs most = top;
        if (most == lowest) break;
        const int best = THREADS - 1 - (int)(most & (THREADS - 1));
        if (i == best) {
            int* row = found.data + 4 * (chosen + 1);
            for (int k = 0; k < 3; ++k) row[k] = ranked.data[4 * i + k];
            row[3] = (int)left;
            left = (longs)least - 1;
        } else if (is_there) {
            const int loss = shared.data[(size_t)i * count + best];
            if (loss > 0) left -= loss;
        }
        __syncthreads();
    }
    if (i == 0) found.data[0] = chosen, found.data[1] = starts.data[starts.shape[0] - 1];
}
