"""Refinement of disparities on CUDA: speckles by union-find, rows filled by warps."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._components_cuda import root, unite

# CUDA's own NaN has other bits than the CPU's.
NAN_BITS = wp.constant(0x7FC00000)
_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)


@wp.func
def none() -> float:
    """Return the NaN that stands for no disparity."""
    return wp.cast(NAN_BITS, float)


@wp.func
def itself(value: float, first: int) -> float:
    """Return a disparity."""
    return value


@wp.func
def of_index(value: int, first: int) -> float:
    """Return the disparity of an index, NaN of a negative one."""
    return wp.where(value >= 0, float(first + value), none())


def _left_right(scalar: Any, disparity_of: Any) -> wp.Kernel:
    """Return the kernel for right disparities of one type."""

    @wp.kernel
    def left_right(
        disparity: wp.array2d[float],  # (H, W)
        right: wp.array2d[scalar],  # (H, W)
        first: int,
        tolerance: float,
        # outputs
        checked: wp.array2d[float],  # (H, W)
    ):
        i = wp.tid()
        width = disparity.shape[1]
        y = i // width
        x = i - y * width
        d = disparity[y, x]
        at = float(x) - wp.floor(d + 0.5)
        kept = none()
        if at >= 0.0 and at < float(width):
            if wp.abs(d - disparity_of(right[y, int(at)], first)) <= tolerance:
                kept = d
        checked[y, x] = kept

    return left_right


left_rights = {
    wp.int32: _left_right(wp.int32, of_index),
    wp.float32: _left_right(wp.float32, itself),
}


# Speckles: as hysteresis in edges/_masks_cuda.py, a tree of labels for each region.


@wp.func
def joined(disparity: wp.array2d[float], y: int, x: int, dy: int, dx: int, most: float) -> bool:
    """Tell whether a pixel and the one at (dy, dx) from it, inside, are of one region."""
    return wp.abs(disparity[y, x] - disparity[y + dy, x + dx]) <= most


@wp.func_native("""
    // The first pixel of the run that this one is in, within the pixels of its warp.
    const int lane = threadIdx.x % 32, rest = pixels - (pixel - lane);
    const unsigned mask = 0xffffffffu >> (rest < 32 ? 32 - rest : 0);
    const unsigned starts = __ballot_sync(mask, begins || lane == 0);
    return pixel - lane + 31 - __clz(starts & (0xffffffffu >> (31 - lane)));
""")
def start_of_run(pixel: int, pixels: int, begins: bool) -> int: ...


@wp.kernel
def plant(
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    i = wp.tid()
    width = disparity.shape[1]
    y = i // width
    x = i - y * width
    begins = x == 0
    if x > 0:
        begins = not joined(disparity, y, x, 0, -1, difference)
    parents[i] = start_of_run(i, parents.shape[0], begins)
    sizes[i] = 0


@wp.kernel
def merge(
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs
    parents: wp.array[int],  # (H W,)
):
    i = wp.tid()
    width = disparity.shape[1]
    y = i // width
    x = i - y * width
    before = bool(False)
    if x > 0:
        before = joined(disparity, y, x, 0, -1, difference)
    if before and i % 32 == 0:  # a run goes on from the pixels of another warp
        unite(parents, i, i - 1)
    if y > 0:
        if joined(disparity, y, x, -1, 0, difference):
            # Where the pixels before are joined in the same way, their thread does it.
            done = bool(False)
            if before:
                done = joined(disparity, y, x - 1, -1, 0, difference) and joined(
                    disparity, y - 1, x, 0, -1, difference
                )
            if not done:
                unite(parents, i, i - width)


@wp.kernel
def count(
    min_size: int,
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    # Nothing is counted beyond what tells a region from a speckle: large ones would have all
    # threads wait for one number.
    top = root(parents, wp.tid())
    if sizes[top] < min_size:
        wp.atomic_add(sizes, top, 1)


@wp.kernel
def keep(
    disparity: wp.array2d[float],  # (H, W)
    min_size: int,
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
    # outputs
    kept: wp.array2d[float],  # (H, W)
):
    i = wp.tid()
    width = disparity.shape[1]
    y = i // width
    x = i - y * width
    # Not every label has been hung below its root itself: threads of `count` overtake each other.
    top = parents[i]
    while top != parents[top]:
        top = parents[top]
    kept[y, x] = wp.where(sizes[top] >= min_size, disparity[y, x], none())


@wp.func_native("""
    // A warp takes a row, 32 pixels at a time: forth with the disparity before a gap, and back
    // with that behind it.
    const unsigned ALL = 0xffffffffu;
    const int columns = disparity.shape[1], lane = threadIdx.x % 32;
    const int row = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
    const float* from = disparity.data + (long long)row * columns;
    float* to = filled.data + (long long)row * columns;
    unsigned char* is = valid.data + (long long)row * columns;
    const float infinite = __int_as_float(0x7f800000);
    float nearest = infinite;
    for (int base = 0; base < columns; base += 32) {
        const int x = base + lane;
        const float d = x < columns ? from[x] : infinite;
        const bool here = fabsf(d) < infinite;
        const unsigned before = __ballot_sync(ALL, here) & (ALL >> (31 - lane));
        const float other = __shfl_sync(ALL, d, before ? 31 - __clz(before) : 0);
        const float value = before ? other : nearest;
        if (x < columns) {
            to[x] = value;
            is[x] = here;
        }
        nearest = __shfl_sync(ALL, value, 31);
    }
    if (lane == 0) found.data[row] = nearest < infinite;
    __syncwarp();
    nearest = infinite;
    for (int base = (columns - 1) / 32 * 32; base >= 0; base -= 32) {
        const int x = base + lane;
        const float d = x < columns ? from[x] : infinite, left = x < columns ? to[x] : infinite;
        const unsigned behind = __ballot_sync(ALL, fabsf(d) < infinite) & (ALL << lane);
        const float other = __shfl_sync(ALL, d, behind ? __ffs(behind) - 1 : 0);
        const float value = behind ? other : nearest;
        if (x < columns) to[x] = fminf(left, value);
        nearest = __shfl_sync(ALL, value, 0);
    }
""")
def fill_row(
    disparity: wp.array2d[float],
    filled: wp.array2d[float],
    valid: wp.array2d[wp.uint8],
    found: wp.array[int],
): ...


@wp.kernel
def fill(
    disparity: wp.array2d[float],  # (H, W)
    # outputs
    filled: wp.array2d[float],  # (H, W)
    valid: wp.array2d[wp.uint8],  # (H, W)
    found: wp.array[int],  # (H,)
):
    fill_row(disparity, filled, valid, found)


@wp.kernel
def find_sources(
    # outputs
    found: wp.array[int],  # (H,): 1 for rows with a disparity; then the row to fill from, or -1
):
    # One thread: a row needs what the one before has found.
    height = found.shape[0]
    first = int(0)
    while first < height and found[first] == 0:
        first += 1
    source = wp.where(first < height, first, -1)
    for row in range(height):
        if found[row] != 0:
            source = row
        found[row] = source


@wp.kernel
def fill_empty_rows(
    found: wp.array[int],  # (H,)
    # outputs
    filled: wp.array2d[float],  # (H, W)
):
    i = wp.tid()
    row = i // 32
    source = found[row]
    if source != row:
        for x in range(i % 32, filled.shape[1], 32):
            value = none()
            if source >= 0:
                value = filled[source, x]
            filled[row, x] = value


# As _refinement_cpu.py has it, of one pixel, with all of its window in registers.
_MEDIAN = """
    const int height = disparity.shape[0], width = disparity.shape[1];
    const int pixel = blockIdx.x * blockDim.x + threadIdx.x, y = pixel / width, x = pixel % width;
    const int center = guide.data[pixel];
    float v[2 * RADIUS + 1];
    int weight[2 * RADIUS + 1], sum[2 * RADIUS + 1], total = 0;
    #pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i) {
        const int at = PLACE;
        v[i] = __fadd_rn(disparity.data[at], 0.0f);
        weight[i] = v[i] == v[i] ? max(1, contrast - abs(guide.data[at] - center)) : 0;
        sum[i] = weight[i];
        total += weight[i];
    }
    #pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i)
        #pragma unroll
        for (int j = i + 1; j < 2 * RADIUS + 1; ++j) {
            const bool before = v[i] <= v[j];
            sum[j] += before ? weight[i] : 0;
            sum[i] += before ? 0 : weight[j];
        }
    float best = __int_as_float(0x7fc00000);
    #pragma unroll
    for (int i = 0; i < 2 * RADIUS + 1; ++i)
        if (weight[i] > 0 && 2 * sum[i] >= total && !(best <= v[i])) best = v[i];
    smooth.data[pixel] = best;
"""
_ALONG = "y * width + min(max(x + i - RADIUS, 0), width - 1)"
_DOWN = "min(max(y + i - RADIUS, 0), height - 1) * width + x"


@lru_cache
def medians(radius: int) -> list[wp.Kernel]:
    """Return the kernels of one radius: along the rows, and down the columns."""
    return [_median(radius, place) for place in (_ALONG, _DOWN)]


def _median(radius: int, place: str) -> wp.Kernel:
    @wp.func_native(_MEDIAN.replace("PLACE", place).replace("RADIUS", str(radius)))
    def median_of_pixel(
        disparity: wp.array2d[float],
        guide: wp.array2d[wp.uint8],
        contrast: int,
        smooth: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def median(
        disparity: wp.array2d[float],  # (H, W)
        guide: wp.array2d[wp.uint8],  # (H, W)
        contrast: int,
        # outputs
        smooth: wp.array2d[float],  # (H, W)
    ):
        median_of_pixel(disparity, guide, contrast, smooth)

    return median
