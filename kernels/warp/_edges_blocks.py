"""Edges on CUDA: strips of a column in registers, components by union-find."""

import warp as wp

from ..codes import Edge, Thinning
from ._borders import border_index
from ._thinning import compared, is_maximum_between, is_maximum_in_sector, measure

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ROWS = 8
STRIP = wp.constant(ROWS)  # rows that one thread walks down
vec5 = wp.types.vector(5, wp.float32)


@wp.func
def five_pixels(src: wp.array2d[wp.uint8], y: int, x: int, border: int, cval: float) -> vec5:
    """The pixels from x - 2 to x + 2 of row `y`, by `border` outside the image."""
    v = vec5(cval)
    i = border_index(y, src.shape[0], border)
    if i >= 0:
        for k in range(5):
            j = border_index(x + k - 2, src.shape[1], border)
            if j >= 0:
                v[k] = float(src[i, j])
    return v


@wp.func
def state_of(
    dy: float,
    dx: float,
    above: wp.vec3,
    here: wp.vec3,
    below: wp.vec3,
    norm: int,
    rule: int,
    low: float,
    high: float,
) -> wp.uint8:
    """Classify a pixel by what surrounds it."""
    m = measure(dy, dx, norm)
    if not m > low:
        return wp.uint8(0)
    kept = bool(False)
    if rule == Thinning.SECTORS:
        kept = is_maximum_in_sector(
            dy, dx, above[0], above[1], above[2], here[0], here[1], here[2],
            below[0], below[1], below[2],
        )  # fmt: skip
    else:
        kept = is_maximum_between(
            dy, dx, above[0], above[1], above[2], here[0], here[1], here[2],
            below[0], below[1], below[2],
        )  # fmt: skip
    if not kept:
        return wp.uint8(0)
    return wp.uint8(wp.where(m > high, 2, 1))


@wp.kernel
def thin_sobel(
    src: wp.array2d[wp.uint8],  # (H, W)
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    # One thread walks down a strip: three rows of pixels, then three of gradients, in registers.
    strip, x = wp.tid()
    height = src.shape[0]
    width = src.shape[1]
    top = strip * STRIP
    a = five_pixels(src, top - 2, x, border, cval)
    b = five_pixels(src, top - 1, x, border, cval)
    above = wp.vec3()
    here = wp.vec3()
    dy_here = float(0.0)
    dx_here = float(0.0)
    for t in range(STRIP + 2):
        y = top + t - 1
        c = five_pixels(src, y + 1, x, border, cval)
        total = a + b + b + c
        difference = c - a
        a = b
        b = c
        below = wp.vec3()
        dy = wp.vec3()
        dx = wp.vec3()
        for k in range(3):
            dx[k] = total[k + 2] - total[k]
            dy[k] = difference[k] + difference[k + 1] + difference[k + 1] + difference[k + 2]
            if y >= 0 and y < height and x + k >= 1 and x + k <= width:
                below[k] = measure(dy[k], dx[k], norm)
        if t >= 2 and y - 1 < height:
            states[y - 1, x] = state_of(
                dy_here, dx_here, above, here, below, norm, Thinning.SECTORS, low, high
            )
        above = here
        here = below
        dy_here = dy[1]
        dx_here = dx[1]


@wp.kernel
def thin(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    norm: int,
    rule: int,
    low: float,
    high: float,
    # outputs
    states: wp.array2d[wp.uint8],  # (H, W)
):
    # One thread walks down a strip with three rows of gradient lengths in registers.
    strip, x = wp.tid()
    height = dy.shape[0]
    width = dy.shape[1]
    top = strip * STRIP
    above = wp.vec3()
    here = wp.vec3()
    for t in range(STRIP + 2):
        y = top + t - 1
        below = wp.vec3()
        if y >= 0 and y < height:
            for k in range(3):
                if x + k >= 1 and x + k <= width:
                    m = measure(dy[y, x + k - 1], dx[y, x + k - 1], norm)
                    below[k] = compared(m, norm, rule)
        if t >= 2 and y - 1 < height:
            states[y - 1, x] = state_of(
                dy[y - 1, x], dx[y - 1, x], above, here, below, norm, rule, low, high
            )
        above = here
        here = below


# Hysteresis. Pixel i has label i + 1; label 0 stands for all that is strong. Parents are smaller
# than their children, so a weak pixel is kept exactly when its root is 0 (union by atomic
# minimum: Playne and Hawick, "A new algorithm for parallel connected-component labelling on
# GPUs", IEEE TPDS 2018).


@wp.kernel
def plant(
    states: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    parents: wp.array[int],  # (H W + 1,)
    mask: wp.array2d[wp.uint8],  # (H, W)
):
    y, x = wp.tid()
    state = int(states[y, x])
    mask[y, x] = wp.uint8(state // 2)
    if state == Edge.WEAK:
        label = y * states.shape[1] + x + 1
        parent = label
        for i in range(-1, 2):
            for j in range(-1, 2):
                if is_state(states, y + i, x + j, Edge.STRONG):
                    parent = 0
        parents[label] = parent


@wp.kernel
def merge(
    states: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    parents: wp.array[int],  # (H W + 1,)
):
    y, x = wp.tid()
    if int(states[y, x]) == Edge.WEAK:
        width = states.shape[1]
        label = y * width + x + 1
        if is_state(states, y, x - 1, Edge.WEAK):
            unite(parents, label, label - 1)
        for j in range(-1, 2):
            if is_state(states, y - 1, x + j, Edge.WEAK):
                unite(parents, label, label - width + j)


@wp.kernel
def select(
    states: wp.array2d[wp.uint8],  # (H, W)
    parents: wp.array[int],  # (H W + 1,)
    # outputs
    mask: wp.array2d[wp.uint8],  # (H, W)
):
    y, x = wp.tid()
    if int(states[y, x]) == Edge.WEAK and root(parents, y * states.shape[1] + x + 1) == 0:
        mask[y, x] = wp.uint8(1)


@wp.func
def is_state(states: wp.array2d[wp.uint8], y: int, x: int, state: int) -> bool:
    """Tell whether (y, x) lies in the image and has `state`."""
    if y < 0 or x < 0 or y >= states.shape[0] or x >= states.shape[1]:
        return False
    return int(states[y, x]) == state


@wp.func
def root(parents: wp.array[int], label: int) -> int:
    """Follow the parents of `label` up."""
    at = label
    while at != 0 and parents[at] != at:
        at = parents[at]
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
