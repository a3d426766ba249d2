"""Speckles on the CPU: runs within rows, joined from row to row; one thread per slab of rows.

A run is a connected part of a row; its label is its first pixel. Runs form trees within their
region, and the root of a tree holds the size of the region. One thread joins the seams between the
slabs afterwards. Native code compares the neighbours, 64 pixels at once, and copies the runs that
are kept; the bits of a word tell where runs begin, and which pixels join the run above.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_speckles_cpu.h")
def mark(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs, bits of 64 pixels a word
    begins: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    joints: wp.array2d[wp.uint64],  # (H, ceil(W / 64)), from row 1 on
): ...


@_native.kernel("_speckles_cpu.h")
def keep(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    min_size: int,
    begins: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
    # outputs
    kept: wp.array2d[float],  # (H, W)
): ...


@wp.func
def lowest(bits: wp.uint64) -> int:
    """Return the number of the lowest bit that is set."""
    return int(wp.bit_count((bits & (~bits + wp.uint64(1))) - wp.uint64(1)))


@wp.func
def highest(bits: wp.uint64) -> int:
    """Return the number of the highest bit that is set."""
    filled = bits
    for n in range(6):
        filled = filled | (filled >> wp.uint64(1 << n))
    return int(wp.bit_count(filled)) - 1


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
    columns: int,
    begins: wp.array2d[wp.uint64],
    joints: wp.array2d[wp.uint64],
    parents: wp.array[int],
    sizes: wp.array[int],
):
    """Join the runs of a row with those of the row above."""
    one = wp.uint64(1)
    before = wp.uint64(0)  # whether the last pixel joins the row above
    label = int(0)  # begins of the runs, in their rows
    label_above = int(0)
    for k in range(begins.shape[1]):
        own = begins[row, k]
        above = begins[row - 1, k]
        joint = joints[row, k]
        # A pixel after one that joins the same two runs can be left out.
        left = joint & (~((joint << one) | before) | own | above)
        before = joint >> wp.uint64(63)
        while left != wp.uint64(0):
            here = left ^ (left - one)  # the lowest bit, and all below it
            left = left & (left - one)
            if (own & here) != wp.uint64(0):
                label = 64 * k + highest(own & here)
            if (above & here) != wp.uint64(0):
                label_above = 64 * k + highest(above & here)
            a = root_of(parents, row * columns + label)
            b = root_of(parents, (row - 1) * columns + label_above)
            if a != b:
                root = wp.min(a, b)
                other = wp.max(a, b)
                parents[other] = root
                sizes[root] = sizes[root] + sizes[other]
        if own != wp.uint64(0):
            label = 64 * k + highest(own)
        if above != wp.uint64(0):
            label_above = 64 * k + highest(above)


@wp.kernel
def join_slab(
    slab: int,
    first: int,
    last: int,
    columns: int,
    begins: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    joints: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    for row in range(first, last):
        start = row * columns
        for k in range(begins.shape[1]):
            left = begins[row, k]
            while left != wp.uint64(0):
                i = row * columns + 64 * k + lowest(left)
                left = left & (left - wp.uint64(1))
                sizes[start] = i - start
                parents[i] = i
                start = i
        sizes[start] = (row + 1) * columns - start
        if row > first:
            join_rows(row, columns, begins, joints, parents, sizes)


@wp.kernel
def join_slabs(
    slabs: int,
    columns: int,
    begins: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    joints: wp.array2d[wp.uint64],  # (H, ceil(W / 64))
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
):
    rows = wp.int64(begins.shape[0])
    for seam in range(1, slabs):
        row = int(rows * wp.int64(seam) / wp.int64(slabs))
        join_rows(row, columns, begins, joints, parents, sizes)
