"""Nearest descriptors by exact distances, in Warp; the smallest index wins a tie."""

import numpy as np
import warp as wp

from cvkern.kernels.codes.features import BLOCK_ROWS
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view

from . import _matching_cpu as cpu
from . import _matching_cuda as cuda


def find_nearest(
    descriptors: wp.array,
    blocks: wp.array,
    binary: int,
    best: wp.array,
    second: wp.array,
    index: wp.array,
) -> None:
    """Find the two nearest of other rows for the rows of each block; a thread a row.

    A block is (first row, row behind the last, first of the other rows, the one behind their
    last, place of its first result). Distances are squared, or the number of differing bits.
    """
    count = blocks.shape[0]
    rows, size = descriptors.shape
    if descriptors.device.is_cuda:
        words = view(descriptors, wp.uint32, (rows, size // 4))
        inputs = [words, blocks, BLOCK_ROWS, binary]
        launch(cuda.match, count * BLOCK_ROWS, inputs, [best, second, index], BLOCK_ROWS)
        return
    others = blocks.numpy()[:, 2:4]
    images, image_of = np.unique(others, axis=0, return_inverse=True)
    groups = [
        (first, min(cpu.LANES, last - first))
        for begin, last in images.tolist()
        for first in range(begin, last, cpu.LANES)
    ]
    counts = -(-(images[:, 1] - images[:, 0]) // cpu.LANES)
    begins = np.r_[0, np.cumsum(counts)[:-1]][image_of.reshape(-1)]
    number = len(groups)
    table = wp.array(np.array(groups, np.int32), dtype=wp.int32, device="cpu")
    group_of = wp.array(begins.astype(np.int32), dtype=wp.int32, device="cpu")
    device = descriptors.device
    packed = scratch("matching.packed", (number, cpu.LANES * size), wp.uint8, device)
    norms = scratch("matching.norms", (number, cpu.LANES), wp.int32, device)
    parts = slabs(number, number * cpu.LANES * size)
    launch_slabs(cpu.pack, number, parts, [descriptors, table, binary], [packed, norms])
    work = int((others[:, 1] - others[:, 0]).sum()) * BLOCK_ROWS * size // 16
    inputs = [descriptors, blocks, group_of, binary, packed, norms]
    launch_slabs(cpu.match, count, min(count, 4 * slabs(count, work)), inputs,
                 [best, second, index])  # fmt: skip
