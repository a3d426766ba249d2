// needs WORDS WARPS AHEAD BINARY FARTHEST
// The two nearest of other rows, for 32 rows a block of threads: distances |a|^2 + |b|^2 - 2 a b by
// products on tensor cores (`mma`), of bytes, or of bits, whose squares and products are counts of
// ones. A warp has all 32 rows, two tiles of 16, and every WARPS-th group of eight other rows.
//
// Lane 4 g + t holds words t EACH to (t + 1) EACH of row g of a tile: in which order `mma` takes
// the words of a row does not matter, as long as it is the same for both. It gets the products of
// rows g and g + 8 with the others 2 t and 2 t + 1.
void match(wp::array_t<wp::uint32> words, wp::array_t<int> blocks, wp::array_t<int> best,
           wp::array_t<int> second, wp::array_t<int> index) {
    enum { EACH = WORDS / 4 };
    struct Row {
        unsigned int word[EACH];

        void read(const wp::array_t<wp::uint32>& words, int row, int t) {
            const uint2* from = (const uint2*)(words.data + (size_t)row * WORDS + t * EACH);
            for (int k = 0; k < EACH / 2; ++k) {
                const uint2 two = __ldg(from + k);
                word[2 * k] = two.x, word[2 * k + 1] = two.y;
            }
        }

        // Square of the length, of which four lanes have a part each.
        int square() const {
            unsigned int sum = 0;
            for (int k = 0; k < EACH; ++k)
                sum = BINARY ? sum + __popc(word[k]) : __dp4a(word[k], word[k], sum);
            sum += __shfl_xor_sync(~0u, sum, 1);
            return sum + __shfl_xor_sync(~0u, sum, 2);
        }
    };
    struct Nearest {
        int best, second, index;

        void see(int distance, int place) {
            const bool nearer = distance < best;
            second = nearer ? best : distance < second ? distance : second;
            index = nearer ? place : index;
            best = nearer ? distance : best;
        }

        // Join the nearest descriptors of two threads; the smallest index wins a tie.
        void join(int other, int other_second, int other_index) {
            const bool nearer = other < best || (other == best && other_index < index);
            const int last = nearer ? best : other;
            second = nearer ? other_second : second;
            second = last < second ? last : second;
            index = nearer ? other_index : index;
            best = nearer ? other : best;
        }
    };
    __shared__ Nearest found[WARPS][32];
    const int* block = blocks.data + 5 * (blockIdx.x / 2);
    const int first = block[0] + 32 * (blockIdx.x % 2), last = block[1];
    if (first >= last) return;
    const int begin = block[2], end = block[3];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32, g = lane / 4, t = lane % 4;

    Row own[4];  // rows g, g + 8, g + 16, g + 24
    Nearest near[4];
    for (int i = 0; i < 4; ++i) {
        const int row = first + 8 * i + g;
        own[i].read(words, row < last ? row : last - 1, t);
        near[i] = {FARTHEST, FARTHEST, 0};
    }
    // With AHEAD the next group is loaded before this one is compared.
    Row next;
    if (AHEAD) next.read(words, min(begin + 8 * warp + g, end - 1), t);
    for (int j = begin + 8 * warp; j < end; j += 8 * WARPS) {
        if (!AHEAD) next.read(words, min(j + g, end - 1), t);
        const Row other = next;
        if (AHEAD) next.read(words, min(j + 8 * WARPS + g, end - 1), t);
        const int square = other.square();
        const int squares[2] = {__shfl_sync(~0u, square, 8 * t),
                                __shfl_sync(~0u, square, 8 * t + 4)};
        for (int tile = 0; tile < 2; ++tile) {
            const Row &low = own[2 * tile], &high = own[2 * tile + 1];
            int product[4] = {0, 0, 0, 0};
            for (int k = 0; k < EACH; k += 2) {
                // Rows by the first operand, the others by the second.
                if (BINARY)
                    asm("mma.sync.aligned.m16n8k256.row.col.s32.b1.b1.s32.and.popc "
                        "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                        : "+r"(product[0]), "+r"(product[1]), "+r"(product[2]), "+r"(product[3])
                        : "r"(low.word[k]), "r"(high.word[k]), "r"(low.word[k + 1]),
                          "r"(high.word[k + 1]), "r"(other.word[k]), "r"(other.word[k + 1]));
                else
                    asm("mma.sync.aligned.m16n8k32.row.col.s32.u8.u8.s32 "
                        "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                        : "+r"(product[0]), "+r"(product[1]), "+r"(product[2]), "+r"(product[3])
                        : "r"(low.word[k]), "r"(high.word[k]), "r"(low.word[k + 1]),
                          "r"(high.word[k + 1]), "r"(other.word[k]), "r"(other.word[k + 1]));
            }
            for (int i = 0; i < 4; ++i) {
                const int place = j + 2 * t + i % 2;
                if (place < end)
                    near[2 * tile + i / 2].see(squares[i % 2] - 2 * product[i], place - begin);
            }
        }
    }
    for (int i = 0; i < 4; ++i) {
        const int square = own[i].square();
        for (int apart = 1; apart < 4; apart *= 2)
            near[i].join(__shfl_xor_sync(~0u, near[i].best, apart),
                         __shfl_xor_sync(~0u, near[i].second, apart),
                         __shfl_xor_sync(~0u, near[i].index, apart));
        if (t == 0) {
            if (near[i].best < FARTHEST) near[i].best += square;
            if (near[i].second < FARTHEST) near[i].second += square;
            found[warp][8 * i + g] = near[i];
        }
    }
    __syncthreads();
    const int row = first + threadIdx.x;
    if (threadIdx.x < 32 && row < last) {
        Nearest all = found[0][threadIdx.x];
        for (int k = 1; k < WARPS; ++k) {
            const Nearest& part = found[k][threadIdx.x];
            all.join(part.best, part.second, part.index);
        }
        const int at = block[4] + row - block[0];
        best.data[at] = all.best, second.data[at] = all.second, index.data[at] = all.index;
    }
}
