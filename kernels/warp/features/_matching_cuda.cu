// needs WORDS WARPS ROWS BLOCK_ROWS BINARY FARTHEST
// The two nearest of other rows, for ROWS rows a block of threads: distances |a|^2 + |b|^2 - 2 a b
// by products on tensor cores (`mma`), of bytes, or of bits, whose squares and products are counts
// of ones. A warp has all ROWS rows, in tiles of 16, and every WARPS-th group of eight other rows.
//
// Lane 4 g + t holds words t EACH to (t + 1) EACH of row g of a tile: in which order `mma` takes
// the words of a row does not matter, as long as it is the same for both. It gets the products of
// rows g and g + 8 with the others 2 t and 2 t + 1.
//
// A key is 256 (|b|^2 - 2 a b) plus the place among the others of a lane, below 256: less than 2^31
// for 128 bytes. So two minima and a maximum find the nearest, the second, and the smallest place.
void match(wp::array_t<wp::uint32> words, wp::array_t<int> blocks, wp::array_t<int> best,
           wp::array_t<int> second, wp::array_t<int> index) {
    enum { EACH = WORDS / 4, HELD = ROWS / 8, STEP = 8 * WARPS, CHUNK = 128 * STEP };
    enum { NONE = 0x7fffffff };
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
    __shared__ Nearest found[WARPS][ROWS];
    const int* block = blocks.data + 5 * (blockIdx.x / (BLOCK_ROWS / ROWS));
    const int first = block[0] + ROWS * (blockIdx.x % (BLOCK_ROWS / ROWS)), last = block[1];
    if (first >= last) return;
    const int begin = block[2], end = block[3];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32, g = lane / 4, t = lane % 4;

    Row own[HELD];  // rows g, g + 8, g + 16, ...
    for (int i = 0; i < HELD; ++i) own[i].read(words, min(first + 8 * i + g, last - 1), t);
    for (int i = lane; i < ROWS; i += 32) found[warp][i] = {FARTHEST, FARTHEST, 0};
    __syncwarp();
    for (int chunk = begin + 8 * warp; chunk < end; chunk += CHUNK) {
        int near[HELD], next_to[HELD];  // keys
        for (int i = 0; i < HELD; ++i) near[i] = next_to[i] = NONE;
        // The next group is loaded before this one is compared.
        Row next;
        next.read(words, min(chunk + g, end - 1), t);
        const int stop = min(end, chunk + CHUNK);
        for (int j = chunk, place = g % 2; j < stop; j += STEP, place += 2) {
            const Row other = next;
            next.read(words, min(j + STEP + g, end - 1), t);
            int key = 256 * other.square() + place;
            key = j + g < end ? key : NONE;
            const int keys[2] = {__shfl_sync(~0u, key, 8 * t), __shfl_sync(~0u, key, 8 * t + 4)};
            for (int tile = 0; tile < HELD / 2; ++tile) {
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
                    const int at = 2 * tile + i / 2;
                    // Nothing is taken from a row that does not exist.
                    const int seen = keys[i % 2] == NONE ? NONE : keys[i % 2] - 512 * product[i];
                    next_to[at] = min(next_to[at], max(near[at], seen));
                    near[at] = min(near[at], seen);
                }
            }
        }
        for (int i = 0; i < HELD; ++i) {
            const int square = own[i].square();
            const int where = chunk - begin + (near[i] & 255) / 2 * STEP + 2 * t + (near[i] & 1);
            Nearest all = {near[i] == NONE ? FARTHEST : (near[i] >> 8) + square,
                           next_to[i] == NONE ? FARTHEST : (next_to[i] >> 8) + square, where};
            for (int apart = 1; apart < 4; apart *= 2)
                all.join(__shfl_xor_sync(~0u, all.best, apart),
                         __shfl_xor_sync(~0u, all.second, apart),
                         __shfl_xor_sync(~0u, all.index, apart));
            if (t == 0) found[warp][8 * i + g].join(all.best, all.second, all.index);
        }
    }
    __syncthreads();
    const int row = first + threadIdx.x;
    if (threadIdx.x < ROWS && row < last) {
        Nearest all = found[0][threadIdx.x];
        for (int k = 1; k < WARPS; ++k) {
            const Nearest& part = found[k][threadIdx.x];
            all.join(part.best, part.second, part.index);
        }
        const int at = block[4] + row - block[0];
        best.data[at] = all.best, second.data[at] = all.second, index.data[at] = all.index;
    }
}
