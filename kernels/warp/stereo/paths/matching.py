"""Semi-global matching of two images without a volume of costs, in Warp."""

import warp as wp

from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _costs_cuda as match_costs_cuda
from . import _matching_cpu as match_cpu
from . import _matching_cuda as match_cuda
from . import _steps_cpu as path_cpu
from .aggregation import _begin, _lines, _padded


def match_costs(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    costs: wp.array,
) -> None:
    """Compare each pixel of the left image with those of the right: census and grey value."""
    if costs.device.is_cuda:
        match_costs_cuda.match_costs(
            left_bits, right_bits, left, right, first, costs.shape[2], costs
        )
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    unfolded = _unfold(right_bits, right, first, depth, count)
    given = [left_bits, left, unfolded]
    launch_slabs(match_cpu.match_costs, height, count, given, [costs])


def match(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    subpixel: int,
    uniqueness: int,
    top: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
    right_index: wp.array,
) -> None:
    """Do `match_costs`, `aggregate` along the left image, `pick` and `pick_right` in one."""
    if index.device.is_cuda:
        match_cuda.match(
            left_bits, right_bits, left, right, first, count, p1, p2, p2_max, paths, subpixel,
            uniqueness, top, index, disparity, cost, confidence, right_index,
        )  # fmt: skip
        return
    height, width = left.shape
    kept, padded, device = index.shape[0], _padded(count), index.device
    parts = slabs(height, height * width * count)
    unfolded = _unfold(right_bits, right, first, count, parts)
    sums = scratch("semi_global.sums", (kept, width, padded), wp.uint16, device)
    right_row = (kept, width + 2 * padded)
    best = scratch("winner.best", right_row, wp.uint16, device)
    place = scratch("winner.place", right_row, wp.uint16, device)
    launch_slabs(match_cpu.clear_right, kept, parts, [index], [best, place])
    number = path_cpu.BYTE if LARGEST_MATCH_COST + p2_max < 256 else path_cpu.WORD
    lines = _lines(parts, count, number, device)
    sweeps = path_cpu.sweeps(paths)
    for n, (some, step) in enumerate(sweeps):
        last = n == len(sweeps) - 1
        options = [first, count, p1, p2, step, n > 0, last, subpixel, uniqueness, top]
        state = _begin(some, height, width, count, number, device)
        launch_slabs(
            match_cpu.sweep(some, number),
            parts,
            parts,
            [left_bits, left, unfolded, *options, *lines, *state, sums, best, place],
            [index, disparity, cost, confidence],
        )
    launch_slabs(match_cpu.read_right, kept, parts, [count, best, place], [right_index])


def _unfold(bits: wp.array, gray: wp.array, first: int, depth: int, count: int) -> wp.array:
    """Lay out the right image for `match_rows`."""
    height, width = gray.shape
    shape = (match_cpu.LINES * height, width + _padded(depth))
    unfolded = scratch("match.unfolded", shape, wp.uint8, gray.device)
    launch_slabs(match_cpu.unfold, height, count, [bits, gray, first], [unfolded])
    return unfolded
