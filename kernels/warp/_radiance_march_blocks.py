"""Where the samples of each ray go, on CUDA."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func_native("""
    // One block: each thread adds up its share of the rays, the shares are added up by halves.
    __shared__ int sums[256];
    __shared__ int kept;
    const int t = threadIdx.x, rays = spans.shape[0];
    const int share = (rays + 255) / 256;
    const int first = t * share, last = first + share < rays ? first + share : rays;
    int2* span = (int2*)spans.data;
    int sum = 0;
    for (int i = first; i < last; ++i) sum += span[i].y;
    sums[t] = sum;
    if (t == 0) kept = 0;
    __syncthreads();
    for (int step = 1; step < 256; step *= 2) {
        const int before = t >= step ? sums[t - step] : 0;
        __syncthreads();
        sums[t] += before;
        __syncthreads();
    }
    int end = sums[t] - sum, mine = 0;
    for (int i = first; i < last; ++i) {
        const int begin = end, count = span[i].y;
        end += count;
        span[i] = make_int2(begin, end > capacity ? 0 : count);
        if (end <= capacity) mine = end;
    }
    atomicMax(&kept, mine);
    __syncthreads();
    if (t == 0) total.data[0] = kept;
""")
def place_shares(capacity: int, spans: wp.array2d[int], total: wp.array[int]): ...


@wp.kernel
def place(
    capacity: int,
    # outputs
    spans: wp.array2d[int],  # (R, 2)
    total: wp.array[int],  # (1,)
):
    place_shares(capacity, spans, total)
