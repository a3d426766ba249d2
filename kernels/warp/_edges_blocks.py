"""Edges on CUDA: strips of a column in registers, components by union-find."""

import warp as wp

from ..codes import Edge, Thinning
from ._borders import border_index
from ._thinning import compared, is_maximum_between, is_maximum_in_sector, measure

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

ROWS = 8
STRIP = wp.constant(ROWS)  # rows that one thread walks down
vec5 = wp.types.vector(5, wp.float32)
vec5i = wp.types.vector(5, wp.int32)


@wp.func
def five_pixels(
    src: wp.array2d[wp.uint8], y: int, columns: vec5i, border: int, cval: float
) -> vec5:
    """The pixels of row `y` in five columns, by `border` outside the image."""
    v = vec5(cval)
    i = border_index(y, src.shape[0], border)
    if i >= 0:
        for k in range(5):
            if columns[k] >= 0:
                v[k] = float(src[i, columns[k]])
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
    columns = vec5i()
    for k in range(5):
        columns[k] = border_index(x + k - 2, width, border)
    a = five_pixels(src, top - 2, columns, border, cval)
    b = five_pixels(src, top - 1, columns, border, cval)
    above = wp.vec3()
    here = wp.vec3()
    dy_here = float(0.0)
    dx_here = float(0.0)
    for t in range(STRIP + 2):
        y = top + t - 1
        c = five_pixels(src, y + 1, columns, border, cval)
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
    words: wp.array[wp.uint64],  # the same bytes, eight at a time
    # outputs
    parents: wp.array[int],  # (H W + 1,)
    mask: wp.array2d[wp.uint8],  # (H, W)
):
    # One thread takes eight pixels, most of which are no edges.
    first = wp.tid() * 8
    word = eight(states, words, first)
    for k in range(8):
        state = int((word >> wp.uint64(8 * k)) & wp.uint64(255))
        i = first + k
        if i < states.shape[0] * states.shape[1]:
            y = i // states.shape[1]
            x = i - y * states.shape[1]
            mask[y, x] = wp.uint8(state // 2)
            if state == Edge.WEAK:
                parent = i + 1
                for dy in range(-1, 2):
                    for dx in range(-1, 2):
                        if is_state(states, y + dy, x + dx, Edge.STRONG):
                            parent = 0
                parents[i + 1] = parent


@wp.kernel
def merge(
    states: wp.array2d[wp.uint8],  # (H, W)
    words: wp.array[wp.uint64],
    # outputs
    parents: wp.array[int],  # (H W + 1,)
):
    first = wp.tid() * 8
    word = eight(states, words, first)
    width = states.shape[1]
    if word != wp.uint64(0):
        for k in range(8):
            if int((word >> wp.uint64(8 * k)) & wp.uint64(255)) == Edge.WEAK:
                i = first + k
                y = i // width
                x = i - y * width
                if is_state(states, y, x - 1, Edge.WEAK):
                    unite(parents, i + 1, i)
                for dx in range(-1, 2):
                    if is_state(states, y - 1, x + dx, Edge.WEAK):
                        unite(parents, i + 1, i + 1 - width + dx)


@wp.kernel
def select(
    states: wp.array2d[wp.uint8],  # (H, W)
    words: wp.array[wp.uint64],
    parents: wp.array[int],  # (H W + 1,)
    # outputs
    mask: wp.array2d[wp.uint8],  # (H, W)
):
    first = wp.tid() * 8
    word = eight(states, words, first)
    if word != wp.uint64(0):
        for k in range(8):
            if int((word >> wp.uint64(8 * k)) & wp.uint64(255)) == Edge.WEAK:
                if root(parents, first + k + 1) == 0:
                    y = (first + k) // states.shape[1]
                    mask[y, first + k - y * states.shape[1]] = wp.uint8(1)


@wp.func
def eight(states: wp.array2d[wp.uint8], words: wp.array[wp.uint64], first: int) -> wp.uint64:
    """States of the pixels from `first` on in one word; NONE behind the last."""
    if first // 8 < words.shape[0]:
        return words[first // 8]
    word = wp.uint64(0)
    for k in range(8):
        i = first + k
        if i < states.shape[0] * states.shape[1]:
            y = i // states.shape[1]
            state = states[y, i - y * states.shape[1]]
            word = word | (wp.uint64(state) << wp.uint64(8 * k))
    return word


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
