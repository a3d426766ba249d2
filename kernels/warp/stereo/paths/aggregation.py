"""Semi-global aggregation of matching costs, in Warp.

Let q be the pixel before p on a path, C the costs, and m the smallest L(q). Then the cost of the
cheapest path to p at disparity d is

    L(p, d) = C(p, d) + min(L(q, d), L(q, d - 1) + P1, L(q, d + 1) + P1, m + P2) - m

and the result is the sum over the paths from all directions (H. Hirschmueller, IEEE PAMI 30(2),
2008, equations 13 and 14). On the CPU threads share tasks of a few rows and diagonals; on CUDA a
group of threads walks each path.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Penalties
from cvkern.kernels.warp._launch import launch_slabs, slabs
from cvkern.kernels.warp.stereo._winners_cpu import padded

from . import _aggregation_cpu as cpu
from . import _aggregation_cuda as cuda
from . import _steps_cpu as steps


def aggregate(
    costs: wp.array, guide: wp.array, penalties: Penalties, paths: int, top: int, sums: wp.array
) -> None:
    """Sum the costs of the cheapest paths to each pixel and disparity; the sums begin at row `top`.

    A guide of shape (1, 1) means that there is none.
    """
    if sums.device.is_cuda:
        cuda.aggregate(costs, guide, penalties, paths, top, sums)
        return
    count = slabs(costs.shape[0], costs.size)
    lines = steps.lines(count, costs.shape[2], steps.WORD, sums.device)
    sweeps = steps.sweeps(paths)
    for n, (some, step) in enumerate(sweeps):
        slots, tasks = steps.begin(some, steps.WORD, costs.shape, sums.device)
        work = steps.work_of(steps.WORD)()
        work.costs, work.totals, work.slots = *lines, slots
        place = n > 0, n < len(sweeps) - 1
        course = steps.course_of(penalties, step, place, top, tasks)
        kernel = cpu.sweep(costs.dtype, some)
        launch_slabs(kernel, count, count, [costs, guide, course, work], [sums])


def aggregation_bytes(device: str, height: int, width: int, depth: int, paths: int, p2: int) -> int:
    """Return a bound on the bytes of the work, in addition to the costs and the sums."""
    reach = padded(depth)
    if device == "cpu":
        return 2 * 6 * (height + width) * (reach + 32)
    lines = min(paths, 8) * (1 if p2 < 256 else 2)
    return height * width * reach * (lines + 2)
