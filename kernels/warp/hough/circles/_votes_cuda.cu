// needs BLOCK
// One thread per pixel, one warp per word of 32 pixels.
void pack(wp::array_t<wp::uint8> mask, int top, int left, wp::array_t<wp::uint32> bits) {
    const int rows = bits.shape[1], pitch = bits.shape[2], height = mask.shape[1];
    const size_t i = (size_t)blockIdx.x * BLOCK + threadIdx.x;
    const int line = i / (32 * pitch), image = line / rows;
    const int y = line - image * rows - top, width = mask.shape[2];
    const int x = (int)(i - (size_t)line * 32 * pitch) - left;
    const bool inside = image < bits.shape[0] && y >= 0 && y < height && x >= 0 && x < width;
    const unsigned word = __ballot_sync(
        0xffffffffu, inside && mask.data[((size_t)image * height + y) * width + x] != 0);
    if (threadIdx.x % 32 == 0 && image < bits.shape[0]) bits.data[i / 32] = word;
}

// needs BLOCK
// A thread has a word of 32 pixels in two rows of one ring of an image. The number of the ring's offsets is a
// multiple of eight. Bit p of the counts of row r is `sums[r][p]`. The threads of a warp exchange
// their counts in shared memory: each has 32 pixels of one word, and writes one pixel of 32 words.
void vote_rings(wp::array_t<wp::uint32> bits, wp::array_t<wp::uint32> places,
                wp::array_t<int> starts, bool shares, wp::array_t<int> votes) {
    const int columns = votes.shape[2], rows = votes.shape[1], pitch = bits.shape[2];
    const int words = (columns + 31) / 32, items = words * ((rows + 1) / 2);
    const int blocks = (items + BLOCK - 1) / BLOCK, plane = blockIdx.x / blocks;
    const int image = plane / (starts.shape[0] - 1), ring = plane % (starts.shape[0] - 1);
    const int lane = threadIdx.x % 32;
    const int item = (blockIdx.x - plane * blocks) * BLOCK + threadIdx.x;
    const bool works = item < items;
    const int row = works ? item / words * 2 : rows, word = works ? item % words : 0;
    const int first = starts.data[ring], last = starts.data[ring + 1];
    const int used = 32 - __clz(last - first);
    unsigned sums[2][20];
#pragma unroll
    for (int p = 0; p < 20; ++p) sums[0][p] = sums[1][p] = 0;
    const auto add = [](unsigned& sum, unsigned a, unsigned b) {
        const unsigned half = sum ^ a, carry = (sum & a) | (half & b);
        sum = half ^ b;
        return carry;
    };
    if (works) {
        const unsigned* from = bits.data + ((size_t)image * bits.shape[1] + row) * pitch + word;
        for (int k = first; k < last; k += 8) {
            unsigned moved[2][8];
#pragma unroll
            for (int j = 0; j < 8; ++j) {
                const unsigned place = places.data[k + j], shift = place % 32;
                const unsigned* at = from + place / 32;
                moved[0][j] = __funnelshift_r(at[0], at[1], shift);
                moved[1][j] = __funnelshift_r(at[pitch], at[pitch + 1], shift);
            }
#pragma unroll
            for (int r = 0; r < 2; ++r) {
                unsigned* s = sums[r];
                const unsigned* m = moved[r];
                const unsigned a = add(s[0], m[0], m[1]), b = add(s[0], m[2], m[3]);
                const unsigned c = add(s[1], a, b);
                const unsigned d = add(s[0], m[4], m[5]), e = add(s[0], m[6], m[7]);
                const unsigned f = add(s[1], d, e);
                unsigned carry = add(s[2], c, f);
#pragma unroll
                for (int p = 3; p < 20; ++p) {
                    if (carry == 0) break;
                    const unsigned both = s[p] & carry;
                    s[p] ^= carry;
                    carry = both;
                }
            }
        }
    }
    __shared__ __align__(16) unsigned handed[BLOCK][20];
    const unsigned (*warp)[20] = handed + threadIdx.x / 32 * 32;
    for (int r = 0; r < 2; ++r) {
        __syncwarp();
#pragma unroll
        for (int p = 0; p < 20; ++p) handed[threadIdx.x][p] = r == 0 ? sums[0][p] : sums[1][p];
        __syncwarp();
        for (int i = 0; i < 32; ++i) {
            const int y = __shfl_sync(0xffffffffu, row, i) + r;
            const int x = __shfl_sync(0xffffffffu, word, i) * 32 + lane;
            int count = 0;
            for (int p = 0; p < used; p += 4) {
                const uint4 four = *reinterpret_cast<const uint4*>(&warp[i][p]);
                count += (four.x >> lane & 1) << p | (four.y >> lane & 1) << (p + 1) |
                         (four.z >> lane & 1) << (p + 2) | (four.w >> lane & 1) << (p + 3);
            }
            if (y < rows && x < columns) {
                const wp::float32 share = (wp::float32)count / (wp::float32)(last - first);
                if (shares) count = __float_as_int(share);
                votes.data[((size_t)plane * rows + y) * columns + x] = count;
            }
        }
    }
}
