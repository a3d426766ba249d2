// needs WORDS MOST
// The best words of 16 patches a warp: products of bytes on tensor cores (`mma`). The warps of a
// block read 32 words at a time into shared memory.
//
// Lane 4 g + t holds bytes 8 t to 8 t + 7 of every 32 bytes of row g of a tile: in which order `mma`
// takes the bytes of a row does not matter, as long as it is the same for both. It gets the products
// of rows g and g + 8 with the words 2 t and 2 t + 1.
void match(wp::array_t<wp::uint32> patches, wp::array_t<wp::uint32> words, int least,
           wp::array_t<int> products, wp::array_t<int> matches) {
    // Rows of the tile are 8 or 24 numbers behind one another, modulo 32: so no two lanes of a half
    // warp read the same bank.
    enum { WARPS = 4, STEPS = WORDS / 8, TILE = 32, ROW = WORDS + (WORDS % 16 ? 0 : 8) };
    // The best so far: the largest product first, the smallest index in a tie.
    struct Best {
        int product[MOST], word[MOST];

        void see(int other, int index) {
            if (other < product[MOST - 1] || (other == product[MOST - 1] && index > word[MOST - 1]))
                return;
#pragma unroll
            for (int m = 0; m < MOST; ++m) {
                const bool before = other > product[m] || (other == product[m] && index < word[m]);
                const int p = product[m], w = word[m];
                product[m] = before ? other : p, word[m] = before ? index : w;
                other = before ? p : other, index = before ? w : index;
            }
        }
    };
    __shared__ alignas(16) unsigned int tile[TILE * ROW];
    const int last = patches.shape[0], count = words.shape[0];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32, g = lane / 4, t = lane % 4;
    const int first = 16 * (WARPS * blockIdx.x + warp);
    const auto read = [&](int row, int k) {
        const size_t from = (size_t)(row < last ? row : last - 1) * WORDS + 8 * k + 2 * t;
        return __ldg((const uint2*)(patches.data + from));
    };
    uint2 low[STEPS], high[STEPS];
#pragma unroll
    for (int k = 0; k < STEPS; ++k) low[k] = read(first + g, k), high[k] = read(first + g + 8, k);
    Best best[2];
#pragma unroll
    for (int m = 0; m < MOST; ++m)
        for (int i = 0; i < 2; ++i) best[i].product[m] = least - 1, best[i].word[m] = 0x7fffffff;
    for (int begin = 0; begin < count; begin += TILE) {
        __syncthreads();
        for (int k = threadIdx.x; k < TILE * WORDS / 2; k += 32 * WARPS) {
            const int row = k / (WORDS / 2), at = 2 * (k % (WORDS / 2));
            uint2 two = make_uint2(0, 0);
            if (begin + row < count)
                two = __ldg((const uint2*)(words.data + (size_t)(begin + row) * WORDS + at));
            *(uint2*)(tile + row * ROW + at) = two;
        }
        __syncthreads();
#pragma unroll
        for (int j = 0; j < TILE; j += 8) {
            int product[4] = {0, 0, 0, 0};
#pragma unroll
            for (int k = 0; k < STEPS; ++k) {
                const uint2 other = *(const uint2*)(tile + (j + g) * ROW + 8 * k + 2 * t);
                asm("mma.sync.aligned.m16n8k32.row.col.s32.s8.s8.s32 "
                    "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                    : "+r"(product[0]), "+r"(product[1]), "+r"(product[2]), "+r"(product[3])
                    : "r"(low[k].x), "r"(high[k].x), "r"(low[k].y), "r"(high[k].y), "r"(other.x),
                      "r"(other.y));
            }
#pragma unroll
            for (int i = 0; i < 4; ++i) {
                const int word = begin + j + 2 * t + i % 2;
                if (word < count && product[i] >= least) best[i / 2].see(product[i], word);
            }
        }
    }
#pragma unroll
    for (int i = 0; i < 2; ++i) {
        // Four lanes have words of the same patch: the first collects what the others found.
        for (int apart = 1; apart < 4; ++apart) {
#pragma unroll
            for (int m = 0; m < MOST; ++m) {
                const int product = __shfl_sync(~0u, best[i].product[m], 4 * g + apart);
                const int word = __shfl_sync(~0u, best[i].word[m], 4 * g + apart);
                if (t == 0) best[i].see(product, word);
            }
        }
        const int row = first + 8 * i + g;
        if (t == 0 && row < last)
#pragma unroll
            for (int m = 0; m < MOST; ++m) {
                const bool is = best[i].product[m] >= least;
                products.data[(size_t)row * MOST + m] = is ? best[i].product[m] : 0;
                matches.data[(size_t)row * MOST + m] = is ? best[i].word[m] : -1;
            }
    }
}
