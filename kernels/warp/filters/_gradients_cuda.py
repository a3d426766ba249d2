"""Length sqrt(dx^2 + dy^2) and angle atan2(dy, dx) of gradients on CUDA, one thread per element."""

import warp as wp

from cvkern.kernels.warp._angles import atan2

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.kernel
def polar(
    dy: wp.array[float],
    dx: wp.array[float],
    # outputs
    magnitude: wp.array[float],
    orientation: wp.array[float],
):
    i = wp.tid()
    y = dy[i]
    x = dx[i]
    magnitude[i] = wp.sqrt(x * x + y * y)
    orientation[i] = atan2(y, x)


@wp.kernel
def root_mean_square(
    dy: wp.array[float],
    dx: wp.array[float],
    # outputs
    dst: wp.array[float],
):
    i = wp.tid()
    dst[i] = wp.sqrt((dx[i] * dx[i] + dy[i] * dy[i]) * 0.5)
