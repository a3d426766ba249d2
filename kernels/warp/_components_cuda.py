"""Connected components by union-find on CUDA."""

import warp as wp

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def root(parents: wp.array[int], label: int) -> int:
    """Follow the parents of `label` to the root, and shorten the path by half.

    This writes only to labels that are no longer roots, and only one of their ancestors, so no
    union of another thread is lost.
    """
    at = label
    parent = parents[at]
    while parent != at:
        above = parents[parent]
        if above != parent:
            parents[at] = above
        at = parent
        parent = above
    return at


@wp.func
def unite(parents: wp.array[int], a: int, b: int):
    """Join the trees of `a` and `b` below the smaller of their roots."""
    low = root(parents, a)
    high = root(parents, b)
    while low != high:
        if low > high:
            swap = low
            low = high
            high = swap
        old = wp.atomic_min(parents, high, low)
        if old == high:
            return
        # Another thread has meanwhile joined `high` to another tree, so unite with that tree.
        high = root(parents, old)
        low = root(parents, low)
