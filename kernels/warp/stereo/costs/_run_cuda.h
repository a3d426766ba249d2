// Call ``emit(total, row, x, k)`` with the sums along a run of ALONG columns of one disparity, from
// the sums down the columns of a strip of rows. Integers have running sums; floats are summed again
// for each pixel.
// needs KEPT, SUM, FLOATS, UNROLL, ALONG, BLOCK
const auto sum_run = [](const KEPT* sums, int wide, int width, int depth, int radius_x,
                        const auto& emit) {
    const int runs = (width + ALONG - 1) / ALONG;
    const unsigned places = (unsigned)runs * depth, blocks = (places - 1) / BLOCK + 1;
    const unsigned i = blockIdx.x % blocks * BLOCK + threadIdx.x;
    if (i >= places) return;
    const int row = blockIdx.x / blocks, k = i % depth;
    const int begin = i / depth * ALONG, end = min(begin + ALONG, width);
    const KEPT* from = sums + ((size_t)row * wide + begin) * depth + k;
    const size_t newest = (size_t)2 * radius_x * depth;
    SUM total = 0;
#pragma unroll UNROLL
    for (int x = begin; x < end; ++x, from += depth) {
        if (FLOATS || x == begin || radius_x == 0) {
            total = __ldg(from);
#pragma unroll 4
            for (size_t u = depth; u <= newest; u += depth) total += __ldg(from + u);
        } else {
            total += (SUM)__ldg(from + newest) - (SUM)__ldg(from - depth);
        }
        emit(total, row, x, k);
    }
};
