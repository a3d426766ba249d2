"""Smoothing that ignores masked pixels, and removal of edges near them, pixel by pixel.

The smoothed image s of the unmasked pixels is divided by their smoothed weights w. The derivative
of this quotient is (s / w)' = (s' - s / w w') / w.
"""

import warp as wp

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def cover(
    stride: int,
    first: int,
    last: int,
    image: wp.array2d[float],  # (H, W)
    masked: bool,
    mask: wp.array2d[wp.uint8],  # (H, W), if any pixel may be masked
    # outputs
    covered: wp.array2d[float],  # (H, W)
    weight: wp.array2d[float],  # (H, W)
):
    width = image.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i - y * width
        value = image[y, x]
        share = float(1.0)
        if masked:
            if mask[y, x] == wp.uint8(0):
                value = 0.0
                share = 0.0
        covered[y, x] = value
        weight[y, x] = share


@wp.kernel
def recover(
    stride: int,
    first: int,
    last: int,
    weight: wp.array2d[float],  # (H, W)
    least: float,
    # outputs
    image: wp.array2d[float],  # (H, W)
):
    width = image.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i - y * width
        image[y, x] = image[y, x] / (weight[y, x] + least)


@wp.func
def recovered(value: float, row: float, column: float, cval: float) -> float:
    """Divide by the weight of a pixel; `row` and `column` are the weights along both axes."""
    return value / (row * column + cval * (1.0 - column))


@wp.kernel
def recover_frame(
    rows: wp.array[float],  # (H,)
    columns: wp.array[float],  # (W,)
    cval: float,
    reach: int,
    outer: int,
    beside: int,
    # outputs
    image: wp.array2d[float],  # (N H, W)
):
    # One thread per pixel of the frames: `outer` rows, then `beside` columns of the other rows.
    i = wp.tid()
    height = rows.shape[0]
    width = image.shape[1]
    across = outer * width
    frame = across + (height - outer) * beside
    n = i // frame
    i -= n * frame
    y = int(0)
    x = int(0)
    if i < across:
        y = i // width
        x = i - y * width
        if y >= reach:
            y += height - outer
    else:
        i -= across
        y = i // beside
        x = i - y * beside
        y += reach
        if x >= reach:
            x += width - beside
    if rows[y] != 1.0 or columns[x] != 1.0:
        at = n * height + y
        image[at, x] = recovered(image[at, x], rows[y], columns[x], cval)


@wp.kernel
def recover_frame_rows(
    stride: int,
    first: int,
    last: int,
    rows: wp.array[float],  # (H,)
    columns: wp.array[float],  # (W,)
    cval: float,
    reach: int,
    # outputs
    image: wp.array2d[float],  # (H, W)
):
    width = image.shape[1]
    for y in range(first + wp.tid(), last, stride):
        row = rows[y % rows.shape[0]]
        left = width
        right = width
        if row == 1.0 and 2 * reach < width:
            left = reach
            right = width - reach
        for x in range(left):
            image[y, x] = recovered(image[y, x], row, columns[x], cval)
        for x in range(right, width):
            image[y, x] = recovered(image[y, x], row, columns[x], cval)


@wp.kernel
def recover_slopes(
    stride: int,
    first: int,
    last: int,
    smooth: wp.array2d[float],  # (H, W)
    weight: wp.array2d[float],  # (H, W)
    weight_dy: wp.array2d[float],  # (H, W)
    weight_dx: wp.array2d[float],  # (H, W)
    least: float,
    # outputs
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
):
    # (s / w)' = (s' - s / w w') / w
    width = dy.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i - y * width
        share = weight[y, x] + least
        level = smooth[y, x] / share
        dy[y, x] = (dy[y, x] - level * weight_dy[y, x]) / share
        dx[y, x] = (dx[y, x] - level * weight_dx[y, x]) / share


@wp.kernel
def confine(
    stride: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (N H, W)
    height: int,
    # outputs
    states: wp.array2d[wp.uint8],  # (N H, W)
):
    width = states.shape[1]
    for i in range(first + wp.tid(), last, stride):
        row = i // width
        y = row % height
        x = i - row * width
        whole = y > 0 and x > 0 and y < height - 1 and x < width - 1
        if whole:
            for below in range(-1, 2):
                for beside in range(-1, 2):
                    if mask[row + below, x + beside] == wp.uint8(0):
                        whole = False
        if not whole:
            states[row, x] = wp.uint8(0)
