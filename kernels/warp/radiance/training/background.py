"""The gradient of a learnt background, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch

wp.set_module_options({"enable_backward": False})


@wp.kernel
def parts_kernel(
    d_learnt: wp.array2d[float],  # (R, 3)
    active: wp.array[int],  # (1,)
    # outputs
    parts: wp.array2d[float],  # (P, 3)
):
    """Sum every P-th ray."""
    part, channel = wp.tid()
    total = float(0.0)
    for ray in range(part, active[0], parts.shape[0]):
        total += d_learnt[ray, channel]
    parts[part, channel] = total


@wp.kernel
def sum_kernel(
    parts: wp.array2d[float],  # (P, 3)
    # outputs
    gradients: wp.array[float],  # (3,): added to
):
    """Sum the parts."""
    channel = wp.tid()
    total = float(0.0)
    for part in range(parts.shape[0]):
        total += parts[part, channel]
    gradients[channel] = gradients[channel] + total


def gather(d_learnt: wp.array, active: wp.array, parts: wp.array, gradients: wp.array) -> None:
    """Add `d_learnt` (R, 3) of the first `active` (1,) rays to `gradients` (3,).

    The order of the sum is always the same: rays are added in `parts` (P, 3), then the parts.
    """
    launch(parts_kernel, (parts.shape[0], 3), [d_learnt, active], [parts])
    launch(sum_kernel, 3, [parts], [gradients])
