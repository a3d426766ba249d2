"""Connected components by union-find on CUDA."""

import warp as wp

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def root(parents: wp.array[int], label: int) -> int:
    """Follow the parents of `label` up, and let each label passed skip the next.

    Only labels that are no longer roots are written, and only with one of their ancestors, so
    that no union of another thread is lost.
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
    """Give the trees of `a` and `b` one root, the smaller of theirs."""
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
        # Another thread has hung `high` elsewhere meanwhile: unite with that tree.
        high = root(parents, old)
        low = root(parents, low)
