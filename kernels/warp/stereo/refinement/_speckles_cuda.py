"""Speckles on CUDA: a tree of labels for each region, as in edges/_masks_cuda.py.

One thread per pixel. The threads of a warp find the begin of their run by a ballot, and those of
one label, which needs native code.
"""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._components_cuda import root, unite

from ._none import none

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def joined(disparity: wp.array2d[float], y: int, x: int, dy: int, dx: int, most: float) -> bool:
    """Tell whether a pixel and the one at offset (dy, dx), if inside, belong to one region."""
    return wp.abs(disparity[y, x] - disparity[y + dy, x + dx]) <= most


@_native.func_native("_speckles_cuda.cu")
def start_of_run(pixel: int, pixels: int, begins: bool) -> int: ...


@_native.func_native("_speckles_cuda.cu")
def number_of_label(pixel: int, pixels: int, label: int) -> int: ...


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
    if before and i % 32 == 0:  # the run continues from the pixels of another warp
        unite(parents, i, i - 1)
    if y > 0:
        if joined(disparity, y, x, -1, 0, difference):
            # If the preceding pixels are joined in the same way, their thread joins the runs.
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
    # One thread counts the pixels of a warp that have the same parent. It stops when a region is no
    # speckle any more; otherwise all threads of a large region would wait for one number.
    i = wp.tid()
    parent = parents[i]
    number = number_of_label(i, parents.shape[0], parent)
    if number > 0:
        top = root(parents, parent)
        if top != parent:
            parents[parent] = top
        if sizes[top] < min_size:
            wp.atomic_add(sizes, top, number)


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
    # The parent of a label may not be its root, because threads of `count` run concurrently.
    top = parents[i]
    while top != parents[top]:
        top = parents[top]
    kept[y, x] = wp.where(sizes[top] >= min_size, disparity[y, x], none())
