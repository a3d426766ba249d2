"""Sub-pixel edge points, in Warp: a thread takes rows (CPU), a block of threads a row (CUDA).

Across a blurred straight step the gradient is a Gaussian, along both axes. Its logarithm is a
parabola, and the edge is at the maximum of this parabola. With p and q the logarithms before and
after a pixel less the one at it, the maximum is at the offset ``(p - q) / (2 (p + q))``. There are
two passes: the points of each row are counted, and then listed at the row's place.
"""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs

from . import _subpixel_cpu as cpu
from . import _subpixel_cuda as cuda


def count_edges(dy: wp.array, dx: wp.array, mask: wp.array, counts: wp.array) -> None:
    """Count the sub-pixel edge points of each row."""
    rows = mask.shape[0]
    if counts.device.is_cuda:
        launch(cuda.count_edges, rows * BLOCK, [dy, dx, mask], [counts])
        return
    count = slabs(rows, mask.size)
    launch_slabs(cpu.count_edges, rows, count, [dy, dx, mask, *_lines(mask, count)], [counts])


def gather_edges(
    dy: wp.array,
    dx: wp.array,
    mask: wp.array,
    starts: wp.array,
    points: wp.array,
    orientation: wp.array,
    strength: wp.array,
) -> None:
    """Locate the edge points of each row, and list them at its place in `starts`."""
    rows, outputs = mask.shape[0], [points, orientation, strength]
    if points.device.is_cuda:
        launch(cuda.gather_edges, rows * BLOCK, [dy, dx, mask, starts], outputs)
        return
    count = slabs(rows, mask.size)
    inputs = [dy, dx, mask, starts, *_lines(mask, count)]
    launch_slabs(cpu.gather_edges, rows, count, inputs, outputs)


def _lines(mask: wp.array, count: int) -> list[wp.array]:
    """Return scratch lines for a flag and a column of each pixel of a row."""
    shape = (count, mask.shape[1])
    types = {"flags": wp.uint8, "columns": wp.int32}
    return [scratch(f"subpixel.{name}", shape, t, mask.device) for name, t in types.items()]
