"""Edges on CUDA: a thread thins a strip of four columns; union-find finds components.

Thinning keeps a pixel if it is a maximum along the gradient; its state tells which of the
thresholds it exceeds (Canny, "A computational approach to edge detection", TPAMI 1986). A weak
pixel is kept if it is connected with a strong one.
"""

import warp as wp

from cvkern.kernels.codes.edges import Edge, Thinning
from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._components_cuda import unite

from ._thinning_cuda import compared, is_maximum_between, is_maximum_in_sector, measure

# Without fused multiply-add a gradient has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

ROWS = 8  # rows that one thread walks down
STRIP = wp.constant(ROWS)
QUAD = 4  # columns that one thread takes
vec6 = wp.types.vector(6, wp.float32)
vec8 = wp.types.vector(8, wp.float32)


@wp.func_native("""
    return *reinterpret_cast<const unsigned int*>(src.data + offset);
""")
def load_word(src: wp.array2d[wp.uint8], offset: int) -> wp.uint32: ...


@wp.func_native("""
    *reinterpret_cast<unsigned int*>(dst.data + offset) = word;
""")
def store_word(dst: wp.array2d[wp.uint8], offset: int, word: wp.uint32): ...


@wp.func
def place_of(strip: int, height: int):
    """Return the first row of a strip's image among those of all images, and its row there."""
    strips = (height + STRIP - 1) // STRIP
    image = strip // strips
    return image * height, (strip - image * strips) * STRIP


@wp.func
def byte_of(word: wp.uint32, k: int) -> float:
    """Return byte `k` of a word."""
    return float((word >> wp.uint32(8 * k)) & wp.uint32(255))


@wp.func
def eight_pixels(
    src: wp.array2d[wp.uint8],
    first: int,
    height: int,
    y: int,
    x: int,
    in_words: bool,
    border: int,
    cval: float,
) -> vec8:
    """Return the pixels x - 2 to x + 5 of row `y`; `border` gives those outside the image.

    The image has `height` rows of `src`, beginning with `first`.
    """
    v = vec8(cval)
    i = border_index(y, height, border)
    if i >= 0:
        i += first
        width = src.shape[1]
        if in_words and x >= 4 and x + 8 <= width:
            at = i * width + x
            before = load_word(src, at - 4)
            here = load_word(src, at)
            after = load_word(src, at + 4)
            v[0] = byte_of(before, 2)
            v[1] = byte_of(before, 3)
            for k in range(4):
                v[2 + k] = byte_of(here, k)
            v[6] = byte_of(after, 0)
            v[7] = byte_of(after, 1)
        else:
            for k in range(8):
                j = border_index(x + k - 2, width, border)
                if j >= 0:
                    v[k] = float(src[i, j])
    return v


@wp.func
def state_of(
    dy: float,
    dx: float,
    above: vec6,
    here: vec6,
    below: vec6,
    k: int,
    norm: int,
    rule: int,
    low: float,
    high: float,
) -> wp.uint32:
    """Classify the pixel in column `k` + 1 of three rows of gradient lengths."""
    m = measure(dy, dx, norm)
    if not m > low:
        return wp.uint32(0)
    kept = bool(False)
    if rule == Thinning.SECTORS:
        kept = is_maximum_in_sector(
            dy, dx, above[k], above[k + 1], above[k + 2], here[k], here[k + 1], here[k + 2],
            below[k], below[k + 1], below[k + 2],
        )  # fmt: skip
    else:
        kept = is_maximum_between(
            dy, dx, above[k], above[k + 1], above[k + 2], here[k], here[k + 1], here[k + 2],
            below[k], below[k + 1], below[k + 2], rule == Thinning.FRAMED,
        )  # fmt: skip
    if not kept:
        return wp.uint32(0)
    return wp.uint32(wp.where(m > high, 2, 1))


@wp.func
def write_states(states: wp.array2d[wp.uint8], y: int, x: int, in_words: bool, word: wp.uint32):
    """Store the states of four pixels, except those outside the image."""
    if in_words:
        store_word(states, y * states.shape[1] + x, word)
    else:
        for k in range(QUAD):
            if x + k < states.shape[1]:
                states[y, x + k] = wp.uint8((word >> wp.uint32(8 * k)) & wp.uint32(255))


@wp.kernel
def thin_sobel(
    src: wp.array2d[wp.uint8],  # (N H, W)
    height: int,
    in_words: bool,  # whether rows consist of aligned words
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    # outputs
    states: wp.array2d[wp.uint8],  # (N H, W)
):
    # One thread walks down a strip of four columns, with three rows of pixels and three of
    # gradient lengths in registers.
    strip, quad = wp.tid()
    x = quad * QUAD
    first, top = place_of(strip, height)
    width = src.shape[1]
    a = eight_pixels(src, first, height, top - 2, x, in_words, border, cval)
    b = eight_pixels(src, first, height, top - 1, x, in_words, border, cval)
    above = vec6()
    here = vec6()
    dy_here = vec6()
    dx_here = vec6()
    for t in range(STRIP + 2):
        y = top + t - 1
        c = eight_pixels(src, first, height, y + 1, x, in_words, border, cval)
        total = a + b + b + c
        difference = c - a
        a = b
        b = c
        below = vec6()
        dy = vec6()
        dx = vec6()
        for k in range(6):
            dx[k] = total[k + 2] - total[k]
            dy[k] = difference[k] + difference[k + 1] + difference[k + 1] + difference[k + 2]
            below[k] = measure(dy[k], dx[k], norm)
            if y < 0 or y >= height or x + k < 1 or x + k > width:
                below[k] = 0.0
        if t >= 2 and y - 1 < height:
            word = wp.uint32(0)
            for k in range(QUAD):
                state = state_of(
                    dy_here[k + 1], dx_here[k + 1], above, here, below, k, norm,
                    Thinning.SECTORS, low, high,
                )  # fmt: skip
                word = word | (state << wp.uint32(8 * k))
            write_states(states, first + y - 1, x, in_words, word)
        above = here
        here = below
        dy_here = dy
        dx_here = dx


@wp.func
def on_frame(height: int, width: int, y: int, x: int) -> bool:
    """Tell whether a pixel is in an outermost row or column."""
    return y == 0 or x == 0 or y == height - 1 or x == width - 1


@wp.kernel
def thin(
    dy: wp.array2d[float],  # (N H, W)
    dx: wp.array2d[float],  # (N H, W)
    height: int,
    in_words: bool,
    norm: int,
    rule: int,
    limits: wp.array[float],  # (2,) or (2 N,): what a weak and a strong pixel exceed
    # outputs
    states: wp.array2d[wp.uint8],  # (N H, W)
):
    # The same as thin_sobel, but with the gradients as inputs.
    strip, quad = wp.tid()
    x = quad * QUAD
    first, top = place_of(strip, height)
    at = wp.min(first // height * 2, limits.shape[0] - 2)
    low = limits[at]
    high = limits[at + 1]
    width = dy.shape[1]
    above = vec6()
    here = vec6()
    dy_here = vec6()
    dx_here = vec6()
    for t in range(STRIP + 2):
        y = top + t - 1
        below = vec6()
        down = vec6()
        along = vec6()
        if y >= 0 and y < height:
            for k in range(6):
                if x + k >= 1 and x + k <= width:
                    down[k] = dy[first + y, x + k - 1]
                    along[k] = dx[first + y, x + k - 1]
                    below[k] = compared(measure(down[k], along[k], norm), norm, rule)
        if t >= 2 and y - 1 < height:
            word = wp.uint32(0)
            for k in range(QUAD):
                state = state_of(
                    dy_here[k + 1], dx_here[k + 1], above, here, below, k, norm, rule, low, high
                )
                if rule == Thinning.FRAMED and on_frame(height, width, y - 1, x + k):
                    state = wp.uint32(0)
                word = word | (state << wp.uint32(8 * k))
            write_states(states, first + y - 1, x, in_words, word)
        above = here
        here = below
        dy_here = down
        dx_here = along


# Hysteresis. Pixel i has label i + 1; label 0 represents all strong pixels. Parents are smaller
# than their children, so a weak pixel is kept exactly if its root is 0 (union by atomic minimum:
# Playne and Hawick, "A new algorithm for parallel connected-component labelling on GPUs", IEEE TPDS
# 2018).


@wp.kernel
def plant(
    states: wp.array[wp.uint8],  # (H W,)
    words: wp.array[wp.uint64],  # the same bytes, eight at a time
    # outputs
    parents: wp.array[int],  # (H W + 1,)
    mask: wp.array[wp.uint8],  # (H W,)
    mask_words: wp.array[wp.uint64],
):
    # One thread takes eight pixels, because most pixels are no edges.
    i = wp.tid()
    if i == 0:
        parents[0] = 0
    if i < words.shape[0]:
        word = words[i]
        mask_words[i] = (word >> wp.uint64(1)) & wp.uint64(0x0101010101010101)
        if word != wp.uint64(0):
            for k in range(8):
                parents[8 * i + k + 1] = 8 * i + k + 1
    else:
        for k in range(8 * i, wp.min(8 * i + 8, states.shape[0])):
            mask[k] = wp.uint8(int(states[k]) // 2)
            parents[k + 1] = k + 1


@wp.kernel
def merge(
    states: wp.array[wp.uint8],  # (N H W,)
    height: int,
    width: int,
    # outputs
    parents: wp.array[int],  # (N H W + 1,)
):
    # One thread per pixel. Two preceding neighbours that are adjacent to each other are united by
    # their own threads.
    i = wp.tid()
    if int(states[i]) == Edge.WEAK:
        row = i // width
        x = i - row * width
        y = row % height
        label = i + 1
        if touches_strong(states, height, width, i, y, x):
            unite(parents, label, 0)
        if is_weak(states, width, i - width, y - 1, x):
            unite(parents, label, label - width)
        else:
            if is_weak(states, width, i - 1, y, x - 1):
                unite(parents, label, label - 1)
            elif is_weak(states, width, i - width - 1, y - 1, x - 1):
                unite(parents, label, label - width - 1)
            if is_weak(states, width, i - width + 1, y - 1, x + 1):
                unite(parents, label, label - width + 1)


@wp.kernel
def select(
    states: wp.array[wp.uint8],  # (H W,)
    words: wp.array[wp.uint64],  # the same bytes, eight at a time
    parents: wp.array[int],  # (H W + 1,)
    # outputs
    mask: wp.array[wp.uint8],  # (H W,)
):
    # One thread takes eight pixels, as in `plant`.
    eight = wp.tid()
    if eight < words.shape[0]:
        if (words[eight] & wp.uint64(0x0101010101010101)) == wp.uint64(0):
            return  # none of them is weak
    for i in range(8 * eight, wp.min(8 * eight + 8, states.shape[0])):
        if int(states[i]) == Edge.WEAK:
            at = i + 1
            while at != parents[at]:
                at = parents[at]
            if at == 0:
                mask[i] = wp.uint8(1)


@wp.func
def is_weak(states: wp.array[wp.uint8], width: int, i: int, y: int, x: int) -> bool:
    """Tell whether pixel `i`, in row `y` and column `x`, lies in its image and is weak."""
    if y < 0 or x < 0 or x >= width:
        return False
    return int(states[i]) == Edge.WEAK


@wp.func
def touches_strong(
    states: wp.array[wp.uint8], height: int, width: int, i: int, y: int, x: int
) -> bool:
    """Tell whether one of the eight neighbours of pixel `i`, in row `y`, is strong."""
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if x + dx >= 0 and x + dx < width and y + dy >= 0 and y + dy < height:
                if int(states[i + dy * width + dx]) == Edge.STRONG:
                    return True
    return False
