#include "_points_row.cu"

// One warp per row writes the number of its set pixels, at the next row's place.
void count(wp::array_t<wp::uint8> mask, bool words, wp::array_t<int> starts) {
    const int y = Row::index(), lane = threadIdx.x % 32, columns = mask.shape[1];
    if (y >= mask.shape[0]) return;
    const unsigned char* pixel = mask.data + (size_t)y * columns;
    int number = 0;
    for (int x = 16 * lane; x < columns; x += 512)
        number += __popc(Row::bits(pixel, x, columns, words));
#pragma unroll
    for (int step = 16; step; step /= 2) number += __shfl_xor_sync(0xffffffffu, number, step);
    if (lane == 0) starts.data[y + 1] = number;
}

// needs BLOCK
// One block computes the prefix sum. Each thread adds its share of the rows; the sums of the shares
// are added in doubling steps; then each thread knows the sum before its share, and writes its
// rows.
void add_up(wp::array_t<int> starts) {
    __shared__ int sums[BLOCK];
    const int t = threadIdx.x, length = starts.shape[0] - 1;
    const int share = (length + BLOCK - 1) / BLOCK;
    const int first = 1 + t * share, last = min(first + share, length + 1);
    int sum = 0;
    for (int i = first; i < last; ++i) sum += starts.data[i];
    sums[t] = sum;
    __syncthreads();
    for (int step = 1; step < BLOCK; step *= 2) {
        const int before = t >= step ? sums[t - step] : 0;
        __syncthreads();
        sums[t] += before;
        __syncthreads();
    }
    int total = sums[t] - sum;
    for (int i = first; i < last; ++i) starts.data[i] = total += starts.data[i];
    if (t == 0) starts.data[0] = 0;
}

// One warp per row writes the points of the row, beginning at the row's place in the list.
void gather(wp::array_t<wp::uint8> mask, wp::array_t<int> starts, bool words,
            wp::array_t<int> points) {
    const int y = Row::index(), lane = threadIdx.x % 32, columns = mask.shape[1];
    if (y >= mask.shape[0]) return;
    const unsigned char* pixel = mask.data + (size_t)y * columns;
    int next = starts.data[y];
    if (starts.data[y + 1] == next) return;
    for (int left = 0; left < columns; left += 512) {
        const int x = left + 16 * lane;
        unsigned int bits = Row::bits(pixel, x, columns, words);
        const int number = __popc(bits);
        int upto = number;  // set pixels of this lane and of those before it
#pragma unroll
        for (int step = 1; step < 32; step *= 2) {
            const int before = __shfl_up_sync(0xffffffffu, upto, step);
            if (lane >= step) upto += before;
        }
        int2* to = reinterpret_cast<int2*>(points.data) + next + upto - number;
        while (bits) {
            *to++ = make_int2(y, x + __ffs(bits) - 1);
            bits &= bits - 1;
        }
        next += __shfl_sync(0xffffffffu, upto, 31);
    }
}
