"""Speckles on the CPU: runs within rows, joined from row to row; one thread per slab of rows.

A run is a connected part of a row; its label is its first pixel. Runs form trees within their
region, and the root of a tree holds the size of the region. One thread joins the seams between the
slabs afterwards.
"""

import warp as wp

from ._none import none

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def root_of(parents: wp.array[int], label: int) -> int:
    """Return the root of a label, and halve the path to it."""
    parent = parents[label]
    while parent != label:
        above = parents[parent]
        parents[label] = above
        label = above
        parent = parents[label]
    return label


@wp.func
def join_rows(
    row: int,
    disparity: wp.array2d[float],
    difference: float,
    labels: wp.array[int],
    parents: wp.array[int],
    sizes: wp.array[int],
):
    """Join the runs of a row with those of the row above."""
    columns = disparity.shape[1]
    last = int(-1)
    last_above = int(-1)
    for x in range(columns):
        if wp.abs(disparity[row, x] - disparity[row - 1, x]) <= difference:
            label = labels[row * columns + x]
            above = labels[(row - 1) * columns + x]
            if label != last or above != last_above:
                last = label
                last_above = above
                a = root_of(parents, label)
                b = root_of(parents, above)
                if a != b:
                    root = wp.min(a, b)
                    other = wp.max(a, b)
                    parents[other] = root
                    sizes[root] = sizes[root] + sizes[other]


@wp.kernel
def label_slab(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    columns = disparity.shape[1]
    for row in range(first, last):
        start = row * columns
        before = disparity[row, 0]
        for x in range(columns):
            i = row * columns + x
            here = disparity[row, x]
            if x == 0 or not (wp.abs(here - before) <= difference):
                if x > 0:
                    sizes[start] = i - start
                start = i
                parents[i] = i
            labels[i] = start
            before = here
        sizes[start] = (row + 1) * columns - start
        if row > first:
            join_rows(row, disparity, difference, labels, parents, sizes)


@wp.kernel
def join_slabs(
    slabs: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    labels: wp.array[int],  # (H W,)
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    rows = wp.int64(disparity.shape[0])
    for seam in range(1, slabs):
        row = int(rows * wp.int64(seam) / wp.int64(slabs))
        join_rows(row, disparity, difference, labels, parents, sizes)


@wp.kernel
def keep_regions(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    min_size: int,
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
    # outputs
    kept: wp.array2d[float],  # (H, W)
):
    columns = disparity.shape[1]
    large = bool(False)
    for row in range(first, last):
        for x in range(columns):
            i = row * columns + x
            label = labels[i]
            if label == i:
                while parents[label] != label:
                    label = parents[label]
                large = sizes[label] >= min_size
            kept[row, x] = wp.where(large, disparity[row, x], none())
