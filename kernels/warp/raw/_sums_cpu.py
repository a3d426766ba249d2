"""Sums and ends of logarithms, in integers, on the CPU."""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp._launch import launch_slabs, slabs, view

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SLOTS, _STEPS = wp.constant(codes.SLOTS), wp.constant(float(codes.STEPS))


def add_up(logs: wp.array, sums: wp.array) -> None:
    """Add up seen logarithms (H, W), count them, and find both ends, in (SLOTS, 4) sums."""
    flat = view(logs, wp.float32, (logs.size,))
    launch_slabs(_add_up, logs.size, slabs(logs.size, logs.size), [flat], [sums])


@wp.kernel
def _add_up(
    slab: int,
    first: int,
    last: int,
    logs: wp.array[float],
    # outputs
    sums: wp.array2d[wp.int64],
):
    total = wp.int64(0)
    count = wp.int64(0)
    low = wp.int64(0)
    high = wp.int64(0)
    for i in range(first, last):
        value = logs[i]
        if value > -500.0:
            fixed = wp.int64(wp.floor(value * _STEPS + 0.5))
            total += fixed
            count += wp.int64(1)
            low = wp.max(low, wp.int64(4294967296) - fixed)
            high = wp.max(high, wp.int64(4294967296) + fixed)
    slot = slab % _SLOTS
    if count > wp.int64(0):
        wp.atomic_add(sums, slot, 0, total)
        wp.atomic_add(sums, slot, 1, count)
        wp.atomic_max(sums, slot, 2, low)
        wp.atomic_max(sums, slot, 3, high)
