"""Linear filters on CUDA: several outputs a thread, in registers, from 16-byte loads."""

import warp as wp

from ._borders import border_index
from ._launch import launch

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


TALL, WIDE = wp.constant(8), wp.constant(32)  # threads of a block: 256 in all


@wp.func_native("""
    const float4 v = *reinterpret_cast<const float4*>(src.data + offset);
    return wp::vec4(v.x, v.y, v.z, v.w);
""")
def load4(src: wp.array3d[float], offset: int) -> wp.vec4: ...


@wp.func_native("""
    *reinterpret_cast<float4*>(dst.data + offset) = make_float4(v[0], v[1], v[2], v[3]);
""")
def store4(dst: wp.array3d[float], offset: int, v: wp.vec4): ...


@wp.func
def four_of_row(
    src: wp.array3d[float], plane: int, y: int, x: int, border: int, cval: float
) -> wp.vec4:
    """Elements x to x + 3 of row `y`, by `border` outside the image."""
    i = border_index(y, src.shape[1], border)
    if i < 0:
        return wp.vec4(cval)
    return load4(src, (plane * src.shape[1] + i) * src.shape[2] + x)


@wp.kernel
def columns4(
    src: wp.array3d[float],  # (P, H, N), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,), r > 0
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    # One thread makes 4 rows of 4 columns: each 16-byte load serves 4 sums. A block makes
    # 4 TALL rows of 4 WIDE columns, whose rows it finds again in its cache.
    tile_y, tile_x, down, across = wp.tid()
    height = src.shape[1]
    columns = src.shape[2]
    tiles = (height + 4 * TALL - 1) // (4 * TALL)
    plane = tile_y // tiles
    y = ((tile_y - plane * tiles) * TALL + down) * 4
    x = (tile_x * WIDE + across) * 4
    if y >= height or x >= columns:
        return
    n = taps.shape[0]
    top = y - n // 2
    v = four_of_row(src, plane, top, x, border, cval)
    a = taps[0] * v
    v = four_of_row(src, plane, top + 1, x, border, cval)
    a += taps[1] * v
    b = taps[0] * v
    v = four_of_row(src, plane, top + 2, x, border, cval)
    a += taps[2] * v
    b += taps[1] * v
    c = taps[0] * v
    d = wp.vec4()
    for t in range(3, n):
        v = four_of_row(src, plane, top + t, x, border, cval)
        a += taps[t] * v
        b += taps[t - 1] * v
        c += taps[t - 2] * v
        d += taps[t - 3] * v
    v = four_of_row(src, plane, top + n, x, border, cval)
    b += taps[n - 1] * v
    c += taps[n - 2] * v
    d += taps[n - 3] * v
    v = four_of_row(src, plane, top + n + 1, x, border, cval)
    c += taps[n - 1] * v
    d += taps[n - 2] * v
    v = four_of_row(src, plane, top + n + 2, x, border, cval)
    d += taps[n - 1] * v
    here = (plane * height + y) * columns + x
    store4(dst, here, a)
    if y + 1 < height:
        store4(dst, here + columns, b)
    if y + 2 < height:
        store4(dst, here + 2 * columns, c)
    if y + 3 < height:
        store4(dst, here + 3 * columns, d)


@wp.kernel
def rows4(
    src: wp.array3d[float],  # (P, H, N), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,)
    border: int,
    cval: float,
    # outputs
    dst: wp.array3d[float],
):
    # One thread makes 4 neighbours of a row: each 16-byte load serves all of them.
    plane, y, quad = wp.tid()
    n = taps.shape[0]
    columns = src.shape[2]
    x = quad * 4
    base = (plane * src.shape[1] + y) * columns
    reach = (n // 2 + 3) // 4 * 4
    skipped = reach - n // 2  # elements loaded before the first tap of output 0
    acc = wp.vec4()
    for j in range(reach // 2 + 1):
        at = x - reach + 4 * j
        v = wp.vec4()
        if at >= 0 and at < columns:
            v = load4(src, base + at)
        else:
            for e in range(4):
                i = border_index(at + e, columns, border)
                v[e] = cval
                if i >= 0:
                    v[e] = src[plane, y, i]
        first = 4 * j - skipped
        if first >= 3 and first + 3 < n:
            for e in range(4):
                for k in range(4):
                    acc[k] = acc[k] + taps[first + e - k] * v[e]
        else:
            for e in range(4):
                for k in range(4):
                    t = first + e - k
                    w = taps[wp.clamp(t, 0, n - 1)]
                    acc[k] = wp.where(t >= 0 and t < n, acc[k] + w * v[e], acc[k])
    store4(dst, base + x, acc)


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
    if taps.shape[0] > 1 and _in_quads(src, dst):
        tiles = (planes * -(-height // (4 * TALL)), -(-columns // (4 * WIDE)))
        launch(columns4, (*tiles, TALL, WIDE), [src, taps, border, cval], [dst])
    else:
        launch(columns1, src.shape, [src, taps, border, cval], [dst])


def correlate_rows(
    src: wp.array, taps: wp.array, step: int, border: int, cval: float, dst: wp.array
) -> None:
    """Correlate a (P, H, W step) array along its columns."""
    planes, height, columns = src.shape
    if step == 1 and _in_quads(src, dst):
        launch(rows4, (planes, height, columns // 4), [src, taps, border, cval], [dst])
    else:
        launch(rows1, src.shape, [src, taps, step, border, cval], [dst])


def _in_quads(*arrays: wp.array) -> bool:
    """Tell whether every row of the arrays falls into aligned groups of four floats."""
    return all(a.shape[-1] % 4 == 0 and a.ptr % 16 == 0 for a in arrays)
