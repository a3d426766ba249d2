// List octave, level, row and column of the marks of a row, in the order of the columns. A warp has
// a row: a lane counts the bits of every 32nd word, and the lanes before it tell where they go.
void list_rows(wp::array_t<wp::int64> octaves, wp::array_t<int> words, wp::array_t<int> ends,
               wp::array_t<int> cells) {
    const int row = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) / 32);
    if (row >= ends.shape[0]) return;  // the whole warp
    int at = row ? ends.data[row - 1] : 0;
    if (at == ends.data[row]) return;
    const wp::int64* octave = octaves.data;
    size_t first = 0;
    int o = 0, left = row;
    for (;; octave += 4, ++o) {
        const int rows = (int)(octave[1] * octave[2]);
        if (left < rows) break;
        first += (size_t)rows * ((octave[3] + 31) / 32);
        left -= rows;
    }
    const int height = (int)octave[2], stored = ((int)octave[3] + 31) / 32;
    const int level = left / height + 1, y = left % height, lane = threadIdx.x % 32;
    const int* const line = words.data + first + (size_t)left * stored;
    for (int begin = 0; begin < stored; begin += 32) {
        const int k = begin + lane;
        unsigned word = k < stored ? (unsigned)line[k] : 0u;
        const int count = __popc(word);
        int place = count;  // the sum up to this lane
        for (int apart = 1; apart < 32; apart *= 2) {
            const int before = __shfl_up_sync(~0u, place, apart);
            if (lane >= apart) place += before;
        }
        const int all = __shfl_sync(~0u, place, 31);
        place += at - count;
        for (; word; word &= word - 1)
            ((int4*)cells.data)[place++] = make_int4(o, level, y, 32 * k + __ffs(word) - 1);
        at += all;
    }
}
