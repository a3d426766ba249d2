"""Semi-global aggregation of matching costs, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _aggregation_cpu as cpu
from . import _aggregation_cuda as cuda
from . import _steps_cpu as path_cpu
from ._wavefront_cpu import STATE


def aggregate(
    costs: wp.array,
    guide: wp.array,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    top: int,
    sums: wp.array,
) -> None:
    """Sum the costs of the best ways to each pixel and disparity, for the rows from `top` on."""
    if sums.device.is_cuda:
        cuda.aggregate(costs, guide, p1, p2, p2_max, paths, top, sums)
        return
    height, width, depth = costs.shape
    count = slabs(height, costs.size)
    lines = _lines(count, depth, path_cpu.WORD, sums.device)
    for n, (some, step) in enumerate(path_cpu.sweeps(paths)):
        state = _begin(some, height, width, depth, path_cpu.WORD, sums.device)
        launch_slabs(
            cpu.sweep(costs.dtype, some),
            count,
            count,
            [costs, guide, p1, p2, step, n > 0, top, *lines, *state],
            [sums],
        )


def _padded(depth: int) -> int:
    return -(-depth // path_cpu.PADDED) * path_cpu.PADDED


def _lines(
    count: int, depth: int, number: path_cpu.Number, device: wp.Device
) -> tuple[wp.array, wp.array]:
    """Return the costs and the sums of the pixels that each slab is at."""
    shape = (count, path_cpu.BLOCK * _padded(depth))
    return (
        scratch("semi_global.costs", shape, number.scalar, device),
        scratch("semi_global.totals", shape, wp.uint16, device),
    )


def _begin(
    paths: path_cpu.Paths,
    height: int,
    width: int,
    depth: int,
    number: path_cpu.Number,
    device: wp.Device,
) -> tuple[wp.array, int, int, wp.array]:
    """Return what a sweep starts with: the slots of its chains, its grid of tasks, its tasks."""
    strips = -(-height // path_cpu.STRIP)
    blocks = -(-(width + path_cpu.skew(paths) * (height - 1)) // path_cpu.BLOCK)
    # Behind the last slot, the header of one more: what is next to the last disparity.
    shape = (path_cpu.chains(paths, height, width) + 1, number.header + _padded(depth))
    slots = scratch("semi_global.slots", shape, number.scalar, device)
    tasks = scratch("semi_global.tasks", (STATE + 2 * strips * blocks,), wp.int32, device)
    launch(path_cpu.prepare(number), 1, [strips, blocks], [slots, tasks])
    return slots, strips, blocks, tasks
