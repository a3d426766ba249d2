// needs WORDS MOST
// The best words of 16 patches a block of threads: products of bytes on tensor cores (`mma`). A
// warp has all 16 patches and every WARPS-th group of eight words.
//
// Lane 4 g + t holds parts t EACH to (t + 1) EACH of row g of a tile, in units of four bytes: in
// which order `mma` takes the bytes of a row does not matter, as long as it is the same for both.
// It gets the products of rows g and g + 8 with the words 2 t and 2 t + 1.
void match(wp::array_t<wp::uint32> patches, wp::array_t<wp::uint32> words, int least,
           wp::array_t<int> products, wp::array_t<int> matches) {
    enum { WARPS = 8, EACH = WORDS / 4 };
    struct Row {
        unsigned int part[EACH];

        void read(const wp::array_t<wp::uint32>& from, int row, int t) {
            const uint2* at = (const uint2*)(from.data + (size_t)row * WORDS + t * EACH);
            for (int k = 0; k < EACH / 2; ++k) {
                const uint2 two = __ldg(at + k);
                part[2 * k] = two.x, part[2 * k + 1] = two.y;
            }
        }
    };
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
    __shared__ Best found[WARPS][16];
    const int first = 16 * blockIdx.x, last = patches.shape[0], count = words.shape[0];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32, g = lane / 4, t = lane % 4;
    Row low, high;
    low.read(patches, first + g < last ? first + g : last - 1, t);
    high.read(patches, first + g + 8 < last ? first + g + 8 : last - 1, t);
    Best best[2];
#pragma unroll
    for (int m = 0; m < MOST; ++m)
        for (int i = 0; i < 2; ++i) best[i].product[m] = least - 1, best[i].word[m] = 0x7fffffff;
    for (int j = 8 * warp; j < count; j += 8 * WARPS) {
        Row other;
        other.read(words, j + g < count ? j + g : count - 1, t);
        int product[4] = {0, 0, 0, 0};
#pragma unroll
        for (int k = 0; k < EACH; k += 2)
            asm("mma.sync.aligned.m16n8k32.row.col.s32.s8.s8.s32 "
                "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                : "+r"(product[0]), "+r"(product[1]), "+r"(product[2]), "+r"(product[3])
                : "r"(low.part[k]), "r"(high.part[k]), "r"(low.part[k + 1]), "r"(high.part[k + 1]),
                  "r"(other.part[k]), "r"(other.part[k + 1]));
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            const int word = j + 2 * t + i % 2;
            if (word < count && product[i] >= least) best[i / 2].see(product[i], word);
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
        if (t == 0) found[warp][8 * i + g] = best[i];
    }
    __syncthreads();
    const int row = first + threadIdx.x;
    if (threadIdx.x < 16 && row < last) {
        Best all = found[0][threadIdx.x];
        for (int k = 1; k < WARPS; ++k)
#pragma unroll
            for (int m = 0; m < MOST; ++m)
                all.see(found[k][threadIdx.x].product[m], found[k][threadIdx.x].word[m]);
#pragma unroll
        for (int m = 0; m < MOST; ++m) {
            const bool is = all.product[m] >= least;
            products.data[(size_t)row * MOST + m] = is ? all.product[m] : 0;
            matches.data[(size_t)row * MOST + m] = is ? all.word[m] : -1;
        }
    }
}
