"""Which rays go on, and where their samples go, on CUDA."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
    // A block takes rows and places for its rays at once, in whatever order the blocks come: rays
    // stay beside those they came with, which go through much the same cells.
    const unsigned all = 0xffffffffu;
    __shared__ int2 sums[32];  // of warps: samples, rays
    __shared__ int2 begin;  // of the block
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int upto = number;  // up to and with this ray
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
""")
def append(
    ray: int, number: int, going: wp.array[int], spans: wp.array2d[int], counts: wp.array[int]
) -> int:
    """Return the row of a ray's first sample; it has barriers: all of a block call it as often."""
    ...


@wp.kernel
def place(
    living: int,
    listing: wp.array[int],  # (R,)
    numbers: wp.array[int],  # (R,)
    # outputs
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    rows: wp.array[int],  # (R,): the first of each ray, in the order of the list
    counts: wp.array[int],  # (2,): added to
):
    """List the rays that have samples, and give them rows; whole blocks alone."""
    i = wp.tid()
    ray = int(0)
    number = int(0)
    if i < living:
        ray = listing[i]
        number = numbers[i]
    row = append(ray, number, going, spans, counts)
    if i < living:
        rows[i] = row
