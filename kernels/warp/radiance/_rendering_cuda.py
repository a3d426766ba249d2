"""A round of views on CUDA: a thread finds a ray's next samples, a warp writes those of 32 rays."""

import warp as wp

from ._next_samples import look
from ._space import keep_sample, row, spacing

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


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


@wp.func_native("""
    int lane = 0;  // the last one that begins no later
    #pragma unroll
    for (int step = 16; step > 0; step /= 2) {
        const int other = __shfl_sync(0xffffffffu, first, lane + step);
        lane += other <= at ? step : 0;
    }
    return lane;
""")
def owner(at: int, first: int) -> int:
    """Return the lane whose rows, from its `first` on, have row `at`; for a whole warp."""
    ...


@wp.func_native("return __shfl_sync(0xffffffffu, value, lane);")
def of_lane(value: int, lane: int) -> int: ...


@wp.kernel
def march_on(
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
    bits: wp.array[wp.uint32],  # (levels cells^3 / 32,)
    levels: int,
    cells: int,
    far: float,
    finest: float,
    cone: float,
    most: int,
    few: int,
    living: int,
    unbounded: bool,
    listing: wp.array[int],  # (R,)
    # outputs
    at: wp.array[float],  # (R,)
    taken: wp.array[int],  # (R,)
    times: wp.array[float],  # (M,)
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    counts: wp.array[int],  # (2,): added to
    positions: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    rays: wp.array[int],  # (M,)
):
    """Find the next samples of rays, list those that have any, and write them; whole blocks."""
    i = wp.tid()
    ray = int(0)
    number = int(0)
    if i < living:
        ray = listing[i]
        number = look(
            origins, directions, bits, levels, cells, far, finest, cone, most, few, living, i, ray,
            at, taken, times,
        )  # fmt: skip
    first = append(ray, number, going, spans, counts)
    # The rows of a warp are side by side: lanes take the next 32, whose rays they are.
    lane = i % 32
    begin = of_lane(first, 0)
    end = of_lane(first + number, 31)
    while begin < end:
        sample = begin + lane
        source = owner(sample, first)
        its_ray = of_lane(ray, source)
        its_first = of_lane(first, source)
        if sample < end:
            t = times[(sample - its_first) * living + i - lane + source]
            point = row(origins, its_ray) + t * row(directions, its_ray)
            step = spacing(t, finest, cone)
            keep_sample(sample, its_ray, point, t, step, unbounded, positions, distances, rays)
        begin += 32
