"""Which rays go on, and where their samples go, on CUDA."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
    // A warp takes rows and places for its 32 rays at once, in whatever order the warps come.
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31;
    int upto = number;  // up to and with this ray
    for (int s = 1; s < 32; s *= 2) {
        const int before = __shfl_up_sync(all, upto, s);
        upto += lane >= s ? before : 0;
    }
    const unsigned found = __ballot_sync(all, number > 0);
    int row = 0, place = 0;
    if (lane == 31 && found) {
        row = atomicAdd(counts.data, upto);
        place = atomicAdd(counts.data + 1, __popc(found));
    }
    row = __shfl_sync(all, row, 31) + upto - number;
    place = __shfl_sync(all, place, 31) + __popc(found & ((1u << lane) - 1));
    if (number > 0) {
        going.data[place] = ray;
        ((int2*)spans.data)[place] = make_int2(row, number);
    }
""")
def append(
    ray: int, number: int, going: wp.array[int], spans: wp.array2d[int], counts: wp.array[int]
): ...


@wp.kernel
def place(
    living: int,
    listing: wp.array[int],  # (R,)
    numbers: wp.array[int],  # (R,)
    # outputs
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    counts: wp.array[int],  # (2,): added to
):
    """List the rays that have samples, and give them rows; whole warps alone."""
    i = wp.tid()
    ray = int(0)
    number = int(0)
    if i < living:
        ray = listing[i]
        number = numbers[i]
    append(ray, number, going, spans, counts)
