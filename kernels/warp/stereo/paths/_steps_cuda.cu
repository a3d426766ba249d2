// needs STEPS, BOUNDS, SETS, COUNT, COST_BYTES, PATH_BYTES, COST_TYPE, PATH_TYPE, FAR
// needs AHEAD, CHUNKS, GROUP, BLOCK, FULL, ADAPTIVE, WHOLE
void walk(wp::array_t<COST_TYPE> costs, wp::array_t<wp::uint8> guide, int p1,
          wp::array_t<wp::uint16> p2, int top, wp::array_t<PATH_TYPE> lines) {
    const signed char steps[COUNT][2] = STEPS;
    const int sets[SETS][2] = BOUNDS;  // sets of directions with equal dy: first one, and number
    const unsigned ALL = 0xffffffffu, FIRST = 0x80000000u;
    const int QUADS = 4 * CHUNKS, LOADS = CHUNKS * COST_BYTES, GROUPS = BLOCK / GROUP;
    const int lane = threadIdx.x % GROUP;
    const int height = costs.shape[0], width = costs.shape[1], depth = costs.shape[2];

    // The directions of a set take blocks in turns.
    int block = blockIdx.x, path = 0, dy = 0, dx = 0, count = 0;
    for (int set = 0; set < SETS; ++set) {
        dy = steps[sets[set][0]][0];
        count = dy == 0 ? height : min(abs(dy), height) * width;
        const int blocks = (count + GROUPS - 1) / GROUPS * sets[set][1];
        path = sets[set][0] + block % sets[set][1];
        if (block < blocks) {
            block /= sets[set][1];
            break;
        }
        block -= blocks;
    }
    dx = steps[path][1];
    // Threads without their own path repeat the last one.
    const int number = min(block * GROUPS + threadIdx.x / GROUP, count - 1);
    int y = dy == 0 ? number : number / width, x = dy == 0 ? 0 : number % width;
    const int length = dy == 0 ? width : (height - 1) / abs(dy) + 1;
    if (dy < 0) y = height - 1 - y;
    if (dy == 0 && dx < 0) x = width - 1;

    // The place of the next pixel to load, and whether it is the first of a path (bit 31).
    unsigned place = y * width + x, first = FIRST;
    const int stride = dy * width + dx;
    const int back = (dx < 0 ? -1 : 1) * ((abs(dx) + width - 1) / width) * width;

    // The penalties, each twice in a word: P2 - P1 for larger steps, and P1 for neighbours.
    __shared__ unsigned table[256];
    for (int i = threadIdx.x; i < 256; i += BLOCK) table[i] = (p2.data[i] - p1) * 0x10001u;
    __syncthreads();
    const unsigned near = p1 * 0x10001u;
    unsigned far = table[0];

    // Bytes of a pixel, in costs and in lines.
    const unsigned from_pixel = depth * COST_BYTES, to_pixel = depth * PATH_BYTES;
    const unsigned begin = top * width, end = lines.shape[1] * width, last = height * width - 1;
    const char* from = reinterpret_cast<const char*>(costs.data) + lane * CHUNKS * 16 * COST_BYTES;
    char* to = reinterpret_cast<char*>(lines.data) + lane * CHUNKS * 16 * PATH_BYTES +
               ((long long)path * end - begin) * to_pixel;
    bool has[CHUNKS];
#pragma unroll
    for (int j = 0; j < CHUNKS; ++j) has[j] = FULL || (lane * CHUNKS + j) * 16 < depth;

    // A queue of the next pixels: a loaded pixel is used AHEAD pixels later. Beyond the end of a
    // path, the walk leaves the image, or, along a row, repeats the same pixels.
    uint4 queue[AHEAD][LOADS];
    unsigned places[AHEAD];
    int grey[AHEAD];
#pragma unroll
    for (int k = 0; k < AHEAD; ++k) {
        grey[k] = 0;
#pragma unroll
        for (int j = 0; j < LOADS; ++j) queue[k][j] = make_uint4(FAR, FAR, FAR, FAR);
    }
    const auto load = [&](int k) {
        const unsigned inside = min(place, last);
        const uint4* here =
            reinterpret_cast<const uint4*>(from + (unsigned long long)inside * from_pixel);
#pragma unroll
        for (int j = 0; j < LOADS; ++j)
            if (has[j / COST_BYTES]) queue[k][j] = here[j];
        if (ADAPTIVE) grey[k] = guide.data[inside];
        places[k] = place | first;
        x += dx;
        const bool leaves = (unsigned)x >= (unsigned)width;
        x -= leaves ? back : 0;
        place += leaves ? stride - back : stride;
        first = leaves ? FIRST : 0;
    };
#pragma unroll
    for (int k = 0; k < AHEAD; ++k) load(k);

    // v(d) = L(d) - min L of the pixel before, of disparities (4q, 4q + 2) and (4q + 1, 4q + 3).
    unsigned even[QUADS], odd[QUADS], below = 0, above = 0;
#pragma unroll
    for (int q = 0; q < QUADS; ++q) even[q] = odd[q] = 0;
    for (int t = 0; t < length; t += AHEAD) {
#pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            unsigned cost[2 * QUADS], word[LOADS * 4];
#pragma unroll
            for (int j = 0; j < LOADS; ++j) {
                word[4 * j] = queue[k][j].x;
                word[4 * j + 1] = queue[k][j].y;
                word[4 * j + 2] = queue[k][j].z;
                word[4 * j + 3] = queue[k][j].w;
            }
#pragma unroll
            for (int q = 0; q < QUADS; ++q) {
                const unsigned a = word[COST_BYTES * q], b = word[COST_BYTES * (q + 1) - 1];
                cost[2 * q] = COST_BYTES == 1 ? a & 0xff00ffu : __byte_perm(a, b, 0x5410);
                cost[2 * q + 1] =
                    COST_BYTES == 1 ? __byte_perm(a, 0, 0x4341) : __byte_perm(a, b, 0x7632);
            }
            const unsigned at = places[k] & ~FIRST;
            // The first pixel of a path has L = C, because no pixel precedes it.
            const unsigned both = places[k] & FIRST ? 0 : ALL;
            const unsigned near_now = near & both, far_now = far & both;
            if (ADAPTIVE) far = table[abs(grey[(k + 1) % AHEAD] - grey[k])];
            load(k);

            unsigned least = ALL, change[2 * QUADS], odd_before = below;
#pragma unroll
            for (int q = 0; q < QUADS; ++q) {
                // min(v(d), v(d - 1) + P1, v(d + 1) + P1, P2)
                const unsigned low = __byte_perm(odd_before, odd[q], 0x5432);
                const unsigned next = q + 1 < QUADS ? even[(q + 1) % QUADS] : above;
                const unsigned high = __byte_perm(even[q], next, 0x5432);
                change[2 * q] =
                    __viaddmin_u16x2(__vimin3_u16x2(low, odd[q], far_now), near_now, even[q]);
                change[2 * q + 1] =
                    __viaddmin_u16x2(__vimin3_u16x2(even[q], high, far_now), near_now, odd[q]);
                odd_before = odd[q];
                even[q] = cost[2 * q] + change[2 * q];
                odd[q] = cost[2 * q + 1] + change[2 * q + 1];
                least = __vimin3_u16x2(least, even[q], odd[q]);
                if (WHOLE) change[2 * q] = even[q];
                if (WHOLE) change[2 * q + 1] = odd[q];
            }
            below = __shfl_up_sync(ALL, odd[QUADS - 1], 1, GROUP);
            above = __shfl_down_sync(ALL, even[0], 1, GROUP);
            least = __vminu2(least, __byte_perm(least, least, 0x1032));
#if __CUDA_ARCH__ >= 800
            if (GROUP == 32) {
                least = __reduce_min_sync(ALL, least);
            } else
#endif
            {
#pragma unroll
                for (int o = GROUP / 2; o > 0; o >>= 1)
                    least = min(least, __shfl_xor_sync(ALL, least, o));
            }
#pragma unroll
            for (int q = 0; q < QUADS; ++q) {
                even[q] -= least;
                odd[q] -= least;
            }
            below = lane == 0 ? 0x7fff0000u : below - least;
            above = lane == GROUP - 1 ? 0x7fffu : above - least;

            const bool kept = at - begin < end;
            uint4* out = reinterpret_cast<uint4*>(to + (unsigned long long)at * to_pixel);
#pragma unroll
            for (int j = 0; j < CHUNKS * PATH_BYTES; ++j) {
                unsigned four[4];
#pragma unroll
                for (int i = 0; i < 4; ++i) {
                    const int q = (4 * j + i) / PATH_BYTES;
                    if (PATH_BYTES == 1)
                        four[i] = change[2 * q + 1] * 256 + change[2 * q];
                    else
                        four[i] = __byte_perm(change[2 * q], change[2 * q + 1],
                                              i % 2 == 0 ? 0x5410 : 0x7632);
                }
                if (kept && has[j / PATH_BYTES])
                    __stcs(out + j, make_uint4(four[0], four[1], four[2], four[3]));
            }
        }
    }
}
