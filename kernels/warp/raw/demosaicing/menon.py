"""Menon's demosaicing, in Warp.

The Taichi set has the equations. On the CPU the steps go over extended planes of a strip of rows,
of which a thread takes a slab; on CUDA a warp keeps the rows that the steps need in registers.
"""

import warp as wp

from cvkern.kernels.codes.raw import MARGIN, MENON_MARGINS, STRIP, Menon
from cvkern.kernels.warp._launch import scratch
from cvkern.kernels.warp._spans import spans
from cvkern.kernels.warp.raw.demosaicing import _menon_cuda, planes

STEPS = ("DIFFERENCES", "GREEN", "AT_GREEN", "AT_CHROMA", "REFINE_GREEN", "REFINE_AT_CHROMA")


def menon(raw: wp.array, red_row: int, red_column: int, colours: wp.array) -> None:
    """Fill in the two colours that each pixel misses; red is at (red_row, red_column)."""
    if raw.device.is_cuda:
        _menon_cuda.demosaic(raw, red_row, red_column, colours)
        return
    height, width = raw.shape
    for top in range(0, height, STRIP):
        rows = min(STRIP, height - top)
        shape = (5, rows + 2 * MARGIN, width + 2 * MARGIN)
        strip = scratch("menon.planes", shape, wp.float32, raw.device)
        planes.extend(raw, top, strip)
        for step, margin in zip(Menon, MENON_MARGINS, strict=True):
            tall, wide = shape[1] - 2 * margin, shape[2] - 2 * margin
            inputs = [int(step), red_row, red_column, margin]
            _menon.launch(tall, wide, 4 * tall * wide, inputs, [strip])
        planes.join(strip, 1, 3, 2, top, rows, colours)


@spans("_menon.h", **{name: int(Menon[name]) for name in STEPS})
def _menon(
    row: int,
    left: int,
    right: int,
    step: int,
    red_row: int,
    red_column: int,
    margin: int,
    planes: wp.array3d[float],
): ...
