"""Sums and masks of derivatives, on every device: an element after the other, `stride` apart."""

import warp as wp

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.kernel
def add(
    stride: int,
    first: int,
    last: int,
    dy: wp.array[float],
    dx: wp.array[float],
    # outputs
    dst: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        dst[i] = dy[i] + dx[i]


@wp.kernel
def confine(
    stride: int,
    first: int,
    last: int,
    mask: wp.array3d[wp.uint8],  # (N, H, W)
    # outputs
    dst: wp.array3d[float],  # (N, H, W)
):
    height = dst.shape[1]
    width = dst.shape[2]
    for i in range(first + wp.tid(), last, stride):
        row = i // width
        n = row // height
        y = row - n * height
        x = i - row * width
        whole = y > 0 and x > 0 and y < height - 1 and x < width - 1
        if whole:
            for below in range(-1, 2):
                for beside in range(-1, 2):
                    if mask[n, y + below, x + beside] == wp.uint8(0):
                        whole = False
        if not whole:
            dst[n, y, x] = 0.0
