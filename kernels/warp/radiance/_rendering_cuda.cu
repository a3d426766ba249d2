int append(int ray, int number, wp::array_t<int> going, wp::array_t<int> spans,
           wp::array_t<int> counts) {
    // A block reserves rows and places for all of its rays at once, in any order of the blocks. So
    // neighbouring rays, which cross much the same cells, stay neighbours.
    const unsigned all = 0xffffffffu;
    __shared__ int2 sums[32];  // samples and rays of warps
    __shared__ int2 begin;     // rows and places of the block
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int upto = number;  // sum up to and including this ray
    for (int s = 1; s < 32; s *= 2) {
        const int before = __shfl_up_sync(all, upto, s);
        upto += lane >= s ? before : 0;
    }
    const unsigned found = __ballot_sync(all, number > 0);
    if (lane == 31) sums[warp] = make_int2(upto, __popc(found));
    __syncthreads();
    int row = upto - number, place = __popc(found & ((1u << lane) - 1));
    int samples = 0, rays = 0;
    for (int w = 0; w < warps; ++w) {
        row += w < warp ? sums[w].x : 0;
        place += w < warp ? sums[w].y : 0;
        samples += sums[w].x;
        rays += sums[w].y;
    }
    if (threadIdx.x == 0 && rays) {
        begin = make_int2(atomicAdd(counts.data, samples), atomicAdd(counts.data + 1, rays));
    }
    __syncthreads();
    row += begin.x;
    if (number > 0) {
        going.data[begin.y + place] = ray;
        ((int2*)spans.data)[begin.y + place] = make_int2(row, number);
    }
    return row;
}

int owner(int at, int first) {
    int lane = 0;  // the last lane whose rows begin at or before this row
#pragma unroll
    for (int step = 16; step > 0; step /= 2) {
        const int other = __shfl_sync(0xffffffffu, first, lane + step);
        lane += other <= at ? step : 0;
    }
    return lane;
}
