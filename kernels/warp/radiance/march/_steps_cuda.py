"""Marching of rays on CUDA: a warp a ray, which looks at 32 steps at once; and where samples go.

The steps are those of the CPU to the bit, though each is the one before plus a spacing, rounded:
see `nth_step`. No cell is skipped: 32 steps through empty ones cost as much as a jump.
"""

import warp as wp

from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp.radiance._space import (
    cell_of,
    is_set,
    keep_sample,
    level_of,
    reach,
    reciprocal,
    row,
    spacing,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = 32  # of a ray


@wp.func_native("""
    // While the spacing is the same, and the exponent of t, each step is rounded as the first one.
    // Whether that holds is checked: a step from a lane's place must lead to that of the next.
    const unsigned all = 0xffffffffu;
    const float gap = first + fmaxf(finest, cone * first) - first;
    float t = first + (float)lane * gap;
    const float next = __shfl_down_sync(all, t, 1);
    if (__all_sync(all, lane == 31 || t + fmaxf(finest, cone * t) == next)) return t;
    t = first;
    #pragma unroll
    for (int step = 0; step < 31; ++step) t = step < lane ? t + fmaxf(finest, cone * t) : t;
    return t;
""")
def nth_step(lane: int, first: float, finest: float, cone: float) -> float: ...


@wp.func_native("return __ballot_sync(0xffffffffu, found);")
def found_by(found: bool) -> wp.uint32: ...


@wp.func_native("return __popc(lanes);")
def number_of(lanes: wp.uint32) -> int: ...


@wp.func_native("return __shfl_sync(0xffffffffu, value, 31);")
def of_last_lane(value: float) -> float: ...


@wp.kernel
def march(
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
    bits: wp.array[wp.uint32],  # (levels cells^3 / 32,)
    levels: int,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    most: int,
    jittered: bool,
    unbounded: bool,
    seed: int,
    step: wp.array[int],  # (1,)
    active: wp.array[int],  # (1,): rays behind so many have no samples
    writes: bool,
    # outputs
    spans: wp.array2d[int],  # (R, 2): counted unless `writes`
    positions: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2): distance, and length of the step
    rays: wp.array[int],  # (M,)
):
    """Count the samples of each ray, or write them where `place` said."""
    ray = wp.tid() // 32
    lane = wp.tid() % 32
    begin = spans[ray, 0]
    limit = most
    if writes:
        limit = spans[ray, 1]
    elif ray >= active[0]:
        limit = 0
    count = int(0)
    if limit > 0:
        jitter = float(0.5)
        if jittered:
            jitter = random_unit(seed, step[0], ray, 4)
        origin = row(origins, ray)
        direction = row(directions, ray)
        ends = reach(origin, reciprocal(direction), levels, near, far, finest, cone, jitter)
        first = ends[0]  # of 32 steps
        before = (wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)
        while first < ends[1] and count < limit:
            t = nth_step(lane, first, finest, cone)
            length = spacing(t, finest, cone)
            point = origin + t * direction
            found = bool(False)
            if t < ends[1]:
                level = level_of(point, levels)
                if level < levels:
                    found = is_set(bits, cell_of(point, level, cells))
            lanes = found_by(found)
            own = count + number_of(lanes & before)
            if writes and found and own < limit:
                at = begin + own
                keep_sample(at, ray, point, t, length, unbounded, positions, distances, rays)
            count += number_of(lanes)
            first = of_last_lane(t + length)
    if lane == 0 and not writes:
        spans[ray, 1] = wp.min(count, limit)


@wp.func_native("""
    // One block: four rays a thread, then the next as many.
    const unsigned all = 0xffffffffu;
    __shared__ int sums[8];  // of warps
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    const int rays = spans.shape[0];
    int2* span = (int2*)spans.data;
    int placed = 0;
    for (int first = 4 * threadIdx.x; first - 4 * threadIdx.x < rays; first += 4 * blockDim.x) {
        int counts[4], sum = 0;
        for (int i = 0; i < 4; ++i) {
            counts[i] = first + i < rays ? span[first + i].y : 0;
            sum += counts[i];
        }
        int upto = sum;  // in this warp
        for (int s = 1; s < 32; s *= 2) {
            const int before = __shfl_up_sync(all, upto, s);
            upto += lane >= s ? before : 0;
        }
        if (lane == 31) sums[warp] = upto;
        __syncthreads();
        int end = placed + upto - sum;
        for (int w = 0; w < warps; ++w) {
            end += w < warp ? sums[w] : 0;
            placed += sums[w];
        }
        placed = min(placed, capacity + 1);  // the sum might not fit 32 bits
        __syncthreads();
        for (int i = 0; i < 4 && first + i < rays; ++i) {
            const int begin = end;
            end += counts[i];
            span[first + i] = end > capacity ? make_int2(capacity, 0) : make_int2(begin, counts[i]);
            if (begin <= capacity && end > capacity) {  // the first without room
                total.data[0] = begin;
                active.data[0] = first + i;
            }
        }
    }
    if (threadIdx.x == 0 && placed <= capacity) total.data[0] = placed;
""")
def place_all(
    capacity: int, spans: wp.array2d[int], total: wp.array[int], active: wp.array[int]
): ...


@wp.kernel
def place(
    capacity: int,
    # outputs
    spans: wp.array2d[int],  # (R, 2)
    total: wp.array[int],  # (1,)
    active: wp.array[int],  # (1,): lowered to the rays that have room
):
    """Give each ray the rows behind those of the ray before, as long as there are any."""
    place_all(capacity, spans, total, active)
