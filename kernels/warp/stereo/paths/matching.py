"""Semi-global matching of two images without a volume of costs, in Warp.

The cost of a match is CENSUS_WEIGHT times the Hamming distance of two census transforms of 5 x 5
pixels, plus the difference of the grey values, shifted right by DIFFERENCE_SHIFT, but at most
DIFFERENCE_LIMIT. Its sums over paths are those of aggregation.py with the left image as guide, and
the winners are those of ../winners.py. On the CPU two sweeps compute the costs on the way, and the
second sweep picks the winners. On CUDA the costs are stored as bytes, and each tile of pixels sums
its paths in shared memory.
"""

import warp as wp

from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST, Penalties, Rule, View, Winners
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.stereo import _turned_cpu as turned
from cvkern.kernels.warp.stereo._winner import WinnerArrays, WinnerRule
from cvkern.kernels.warp.stereo._winners_cpu import padded

from . import _costs_cuda as costs_cuda
from . import _matching_cpu as cpu
from . import _matching_cuda as cuda
from . import _steps_cpu as steps
from .aggregation import aggregation_bytes


def match_costs(left: View, right: View, first: int, costs: wp.array) -> None:
    """Compare each pixel of the left image with those of the right: census and grey value."""
    if costs.device.is_cuda:
        costs_cuda.match_costs(left, right, first, costs.shape[2], costs)
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    unfolded = _unfold(right, first, depth, count)
    launch_slabs(cpu.match_costs, height, count, [*left, unfolded], [costs])


def match(
    left: View,
    right: View,
    count: int,
    penalties: Penalties,
    paths: int,
    rule: Rule,
    top: int,
    winners: Winners,
    right_index: wp.array,
) -> None:
    """Do `match_costs`, `aggregate` guided by the left image, `pick` and `pick_right` together.

    There are `count` disparities; the winners are those of the rows from `top` on.
    """
    if right_index.device.is_cuda:
        cuda.match(left, right, count, penalties, paths, rule, top, winners, right_index)
        return
    height, width = left.gray.shape
    kept, reach, device = right_index.shape[0], padded(count), right_index.device
    parts = slabs(height, height * width * count)
    pair = cpu.Pair()
    pair.bits, pair.gray = left
    pair.unfolded = _unfold(right, rule.first, count, parts)
    best = cpu.BestRight()
    row = (kept, width + cpu.LANES)
    best.cost = scratch("match.best", row, wp.uint16, device)
    best.place = scratch("match.place", row, wp.uint16, device)
    best.index = right_index
    sweeps, number = steps.sweeps(paths), steps.WORD
    if LARGEST_MATCH_COST + penalties.most < 256:
        changes = len(sweeps) == 2 and paths // 2 * penalties.most < 256
        number = steps.byte(count, wp.uint8 if changes else wp.uint16)
    lines = steps.lines(parts, count, number, device)
    sums = scratch("semi_global.sums", (kept, width, reach), number.total, device)
    tile = (parts, 2 * (turned.TILE + cpu.LANES) * reach)
    tiles = scratch("match.turned", tile, wp.uint16, device)
    rule_struct, outputs = struct_of(WinnerRule, rule), struct_of(WinnerArrays, winners)
    for n, (some, step) in enumerate(sweeps):
        slots, tasks = steps.begin(some, number, (height, width, count), device)
        work = steps.work_of(number)()
        work.costs, work.totals, work.slots = *lines, slots
        course = steps.course_of(penalties, step, (n > 0, n < len(sweeps) - 1), top, tasks)
        inputs = [pair, count, course, rule_struct, work, tiles, sums, best]
        launch_slabs(cpu.sweep(some, number), parts, parts, inputs, [outputs])


def matching_bytes(device: str, height: int, width: int, depth: int, paths: int, p2: int) -> int:
    """Return a bound on the bytes of a whole match, costs and sums included."""
    reach = padded(depth)
    right = height * (4 * (width + reach) + 4 * (width + 2 * reach))
    volumes = 2 if device == "cpu" else 3
    work = aggregation_bytes(device, height, width, depth, paths, p2)
    return work + volumes * height * width * reach + right


def _unfold(view: View, first: int, depth: int, count: int) -> wp.array:
    """Unfold the right image for _costs_cpu.h."""
    height, width = view.gray.shape
    shape = (cpu.LINES * height, width + padded(depth))
    unfolded = scratch("match.unfolded", shape, wp.uint8, view.gray.device)
    launch_slabs(cpu.unfold, height, count, [*view, first], [unfolded])
    return unfolded
