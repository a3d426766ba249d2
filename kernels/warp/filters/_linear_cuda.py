"""Linear filters on CUDA: 4 x 4 outputs per thread, summed in registers, with 16-byte loads.

A pass is ``out[i] = sum over t of taps[t] * in[i + t - r]``, summed in the order of the taps.
"""

import warp as wp

from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._launch import launch

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


BLOCK = wp.constant(256)  # threads of a block, unless a launch says otherwise
REGISTERS = (256, 4)  # four blocks per multiprocessor, so 64 registers per thread: measured best
TALL, WIDE = wp.constant(8), wp.constant(32)  # arrangement of a block's threads in columns4
vec7 = wp.types.vector(7, wp.float32)


@wp.func_native("""
    const float4 v = *reinterpret_cast<const float4*>(src.data + offset);
    return wp::vec4(v.x, v.y, v.z, v.w);
""")
def load4(src: wp.array3d[float], offset: int) -> wp.vec4: ...


@wp.func_native("""
    return src.data[offset];
""")
def load1(src: wp.array3d[float], offset: int) -> float: ...


@wp.func_native("""
    *reinterpret_cast<float4*>(dst.data + offset) = make_float4(v[0], v[1], v[2], v[3]);
""")
def store4(dst: wp.array3d[float], offset: int, v: wp.vec4): ...


@wp.func
def quad_of_row(src: wp.array3d[float], base: int, y: int, border: int, cval: float) -> wp.vec4:
    """Return four elements of row `y`, with row 0 at `base`; `border` gives those outside."""
    i = border_index(y, src.shape[1], border)
    v = load4(src, base + wp.max(i, 0) * src.shape[2])
    if i < 0:
        v = wp.vec4(cval)
    return v


@wp.func
def row_of(
    src: wp.array3d[float], inside: bool, base: int, y: int, border: int, cval: float
) -> wp.vec4:
    """Return `quad_of_row`, without its tests if all rows are known to be inside."""
    if inside:
        return load4(src, base + y * src.shape[2])
    return quad_of_row(src, base, y, border, cval)


@wp.func
def quad_outside(src: wp.array3d[float], base: int, x: int, border: int, cval: float) -> wp.vec4:
    """Return the values of `border` for elements x to x + 3 of the row at `base`, all outside."""
    v = wp.vec4(cval)
    for e in range(4):
        i = border_index(x + e, src.shape[2], border)
        if i >= 0:
            v[e] = load1(src, base + i)
    return v


@wp.func
def next_taps(w: vec7, taps: wp.array[float], t: int) -> vec7:
    """Return taps t - 3 to t + 3, 0 for those that do not exist, from those of t - 4."""
    v = vec7()
    for i in range(3):
        v[i] = w[i + 4]
    if t >= 0 and t + 3 < taps.shape[0]:
        for i in range(4):
            v[i + 3] = taps[t + i]
    else:
        for i in range(4):
            if t + i >= 0 and t + i < taps.shape[0]:
                v[i + 3] = taps[t + i]
    return v


# Both passes use a 4 x 4 pattern: four successive elements contribute to the four sums of a thread.
# Element e contributes to sum k by tap t + e - k, where t = 4 j - skipped in step j. Adding 0 times
# an element changes no bit, unless the element is infinite or NaN. So a sum that is NaN is computed
# again from the taps that exist.


@wp.func
def add_four(
    acc: wp.vec4, w: vec7, v0: wp.vec4, v1: wp.vec4, v2: wp.vec4, v3: wp.vec4, k: int
) -> wp.vec4:
    """Add four elements to sum `k`."""
    return (((acc + w[3 - k] * v0) + w[4 - k] * v1) + w[5 - k] * v2) + w[6 - k] * v3


@wp.func
def sum_down(
    src: wp.array3d[float], base: int, y: int, taps: wp.array[float], border: int, cval: float
) -> wp.vec4:
    """Sum the rows around row `y`, weighted by the taps."""
    acc = wp.vec4()
    for t in range(taps.shape[0]):
        acc += taps[t] * quad_of_row(src, base, y + t - taps.shape[0] // 2, border, cval)
    return acc


@wp.func
def sum_along(
    src: wp.array3d[float], base: int, x: int, taps: wp.array[float], border: int, cval: float
) -> wp.vec4:
    """Sum the columns around columns x to x + 3, weighted by the taps."""
    acc = wp.vec4()
    for k in range(4):
        for t in range(taps.shape[0]):
            i = border_index(x + k + t - taps.shape[0] // 2, src.shape[2], border)
            v = cval
            if i >= 0:
                v = load1(src, base + i)
            acc[k] = acc[k] + taps[t] * v
    return acc


@wp.func
def has_nan(v: wp.vec4) -> bool:
    """Tell whether an element is not a number."""
    total = v[0] + v[1] + v[2] + v[3]
    return total != total


@wp.kernel(launch_bounds=REGISTERS)
def columns4(
    src: wp.array3d[float],  # (P, H, N), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,)
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    # One thread computes 4 rows of 4 columns. A block computes 4 TALL rows of 4 WIDE columns: its
    # threads share rows, which stay in the cache.
    tile = wp.tid() // BLOCK
    thread = wp.tid() % BLOCK
    height = src.shape[1]
    columns = src.shape[2]
    tiles_x = (columns + 4 * WIDE - 1) // (4 * WIDE)
    tiles_y = (height + 4 * TALL - 1) // (4 * TALL)
    tile_y = tile // tiles_x
    plane = tile_y // tiles_y
    y = ((tile_y - plane * tiles_y) * TALL + thread // WIDE) * 4
    x = ((tile - tile_y * tiles_x) * WIDE + thread % WIDE) * 4
    if y >= height or x >= columns:
        return
    n = taps.shape[0]
    base = plane * height * columns + x
    steps = (n + 6) // 4
    first = y - n // 2
    inside = first >= 0 and first + 4 * steps <= height
    a = wp.vec4()
    b = wp.vec4()
    c = wp.vec4()
    d = wp.vec4()
    w = vec7()
    v0 = row_of(src, inside, base, first, border, cval)
    v1 = row_of(src, inside, base, first + 1, border, cval)
    v2 = row_of(src, inside, base, first + 2, border, cval)
    v3 = row_of(src, inside, base, first + 3, border, cval)
    for j in range(steps):
        # Load the elements of the next step while this step computes.
        at = first + 4 * wp.min(j + 1, steps - 1)
        u0 = row_of(src, inside, base, at, border, cval)
        u1 = row_of(src, inside, base, at + 1, border, cval)
        u2 = row_of(src, inside, base, at + 2, border, cval)
        u3 = row_of(src, inside, base, at + 3, border, cval)
        w = next_taps(w, taps, 4 * j)
        a = add_four(a, w, v0, v1, v2, v3, 0)
        b = add_four(b, w, v0, v1, v2, v3, 1)
        c = add_four(c, w, v0, v1, v2, v3, 2)
        d = add_four(d, w, v0, v1, v2, v3, 3)
        v0 = u0
        v1 = u1
        v2 = u2
        v3 = u3
    if has_nan(a + b + c + d):
        a = sum_down(src, base, y, taps, border, cval)
        b = sum_down(src, base, y + 1, taps, border, cval)
        c = sum_down(src, base, y + 2, taps, border, cval)
        d = sum_down(src, base, y + 3, taps, border, cval)
    here = base + y * columns
    store4(dst, here, a)
    if y + 1 < height:
        store4(dst, here + columns, b)
    if y + 2 < height:
        store4(dst, here + 2 * columns, c)
    if y + 3 < height:
        store4(dst, here + 3 * columns, d)


@wp.kernel(launch_bounds=REGISTERS)
def rows4(
    src: wp.array3d[float],  # (P, H, N), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,)
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    # One thread computes 4 columns of 4 rows, which share the taps.
    columns = src.shape[2]
    quads = columns // 4
    group = wp.tid() // quads
    quad = wp.tid() - group * quads
    rows = src.shape[0] * src.shape[1]
    x = quad * 4
    last = rows - 1
    base0 = 4 * group * columns
    base1 = wp.min(4 * group + 1, last) * columns
    base2 = wp.min(4 * group + 2, last) * columns
    base3 = wp.min(4 * group + 3, last) * columns
    n = taps.shape[0]
    reach = (n // 2 + 3) // 4 * 4
    skipped = reach - n // 2  # elements loaded before the first tap of sum 0
    w = vec7()
    a = wp.vec4()
    b = wp.vec4()
    c = wp.vec4()
    d = wp.vec4()
    for j in range(reach // 2 + 1):
        at = x - reach + 4 * j
        v0 = wp.vec4()
        v1 = wp.vec4()
        v2 = wp.vec4()
        v3 = wp.vec4()
        if at >= 0 and at < columns:
            v0 = load4(src, base0 + at)
            v1 = load4(src, base1 + at)
            v2 = load4(src, base2 + at)
            v3 = load4(src, base3 + at)
        else:
            v0 = quad_outside(src, base0, at, border, cval)
            v1 = quad_outside(src, base1, at, border, cval)
            v2 = quad_outside(src, base2, at, border, cval)
            v3 = quad_outside(src, base3, at, border, cval)
        w = next_taps(w, taps, 4 * j - skipped)
        for e in range(4):
            for k in range(4):
                a[k] = a[k] + w[3 + e - k] * v0[e]
                b[k] = b[k] + w[3 + e - k] * v1[e]
                c[k] = c[k] + w[3 + e - k] * v2[e]
                d[k] = d[k] + w[3 + e - k] * v3[e]
    if has_nan(a + b + c + d):
        a = sum_along(src, base0, x, taps, border, cval)
        b = sum_along(src, base1, x, taps, border, cval)
        c = sum_along(src, base2, x, taps, border, cval)
        d = sum_along(src, base3, x, taps, border, cval)
    store4(dst, base0 + x, a)
    store4(dst, base1 + x, b)
    store4(dst, base2 + x, c)
    store4(dst, base3 + x, d)


@wp.kernel
def columns1(
    src: wp.array3d[float],  # (P, H, N)
    taps: wp.array[float],
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    plane, row, x = wp.tid()
    acc = float(0.0)
    for t in range(taps.shape[0]):
        y = border_index(row + t - taps.shape[0] // 2, src.shape[1], border)
        v = cval
        if y >= 0:
            v = src[plane, y, x]
        acc += taps[t] * v
    dst[plane, row, x] = acc


@wp.kernel
def rows1(
    src: wp.array3d[float],  # (P, H, W step)
    taps: wp.array[float],
    step: int,
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    plane, y, column = wp.tid()
    pixel = column // step
    channel = column - pixel * step
    acc = float(0.0)
    for t in range(taps.shape[0]):
        x = border_index(pixel + t - taps.shape[0] // 2, src.shape[2] // step, border)
        v = cval
        if x >= 0:
            v = src[plane, y, x * step + channel]
        acc += taps[t] * v
    dst[plane, y, column] = acc


def correlate_columns(
    src: wp.array, taps: wp.array, border: int, cval: float, dst: wp.array
) -> None:
    """Correlate a (P, H, N) array down its rows."""
    planes, height, columns = src.shape
    if _in_quads(src, dst):
        tiles = planes * -(-height // (4 * TALL)) * -(-columns // (4 * WIDE))
        launch(columns4, tiles * BLOCK, [src, taps, border, cval], [dst])
    else:
        launch(columns1, src.shape, [src, taps, border, cval], [dst])


def correlate_rows(
    src: wp.array, taps: wp.array, step: int, border: int, cval: float, dst: wp.array
) -> None:
    """Correlate a (P, H, W step) array along its columns."""
    planes, height, columns = src.shape
    if step == 1 and _in_quads(src, dst):
        groups = -(-planes * height // 4)
        launch(rows4, groups * (columns // 4), [src, taps, border, cval], [dst])
    else:
        launch(rows1, src.shape, [src, taps, step, border, cval], [dst])


def _in_quads(*arrays: wp.array) -> bool:
    """Tell whether every row of the arrays consists of aligned groups of four floats."""
    return all(a.shape[-1] % 4 == 0 and a.ptr % 16 == 0 for a in arrays)
