"""Linear filters on CUDA: several outputs a thread, in registers, from 16-byte loads."""

import warp as wp

from ._borders import border_index
from ._launch import launch

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func_native("""
    const float4 v = *reinterpret_cast<const float4*>(src.data + offset);
    return wp::vec4(v.x, v.y, v.z, v.w);
""")
def load4(src: wp.array[float], offset: int) -> wp.vec4: ...


@wp.func_native("""
    *reinterpret_cast<float4*>(dst.data + offset) = make_float4(v[0], v[1], v[2], v[3]);
""")
def store4(dst: wp.array[float], offset: int, v: wp.vec4): ...


@wp.kernel
def columns4(
    src: wp.array[float],  # (P H N,), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,)
    height: int,
    quads: int,  # N / 4
    border: int,
    cval: float,
    # outputs
    dst: wp.array[float],
):
    # One thread makes 4 rows of 4 columns: each element read serves 4 sums.
    plane, strip, quad = wp.tid()
    n = taps.shape[0]
    pitch = quads * 4
    top = strip * 4
    base = plane * height * pitch + quad * 4
    a = wp.vec4()
    b = wp.vec4()
    c = wp.vec4()
    d = wp.vec4()
    for t in range(n + 3):
        y = border_index(top + t - n // 2, height, border)
        v = wp.vec4(cval)
        if y >= 0:
            v = load4(src, base + y * pitch)
        if t < n:
            a += taps[t] * v
        if t >= 1 and t <= n:
            b += taps[t - 1] * v
        if t >= 2 and t <= n + 1:
            c += taps[t - 2] * v
        if t >= 3:
            d += taps[t - 3] * v
    here = base + top * pitch
    store4(dst, here, a)
    if top + 1 < height:
        store4(dst, here + pitch, b)
    if top + 2 < height:
        store4(dst, here + 2 * pitch, c)
    if top + 3 < height:
        store4(dst, here + 3 * pitch, d)


@wp.kernel
def rows4(
    src: wp.array[float],  # (R N,), N a multiple of 4
    taps: wp.array[float],  # (2 r + 1,)
    quads: int,  # N / 4
    border: int,
    cval: float,
    # outputs
    dst: wp.array[float],
):
    # One thread makes 4 neighbours of a row: each 16-byte load serves all of them.
    row, quad = wp.tid()
    n = taps.shape[0]
    columns = quads * 4
    x = quad * 4
    base = row * columns
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
                    v[e] = src[base + i]
        first = 4 * j - skipped
        if first >= 3 and first + 3 < n:
            for e in range(4):
                for k in range(4):
                    acc[k] += taps[first + e - k] * v[e]
        else:
            for e in range(4):
                for k in range(4):
                    t = first + e - k
                    if t >= 0 and t < n:
                        acc[k] += taps[t] * v[e]
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
    if _in_quads(src, dst):
        flat = (src.size,)
        launch(
            columns4,
            (planes, -(-height // 4), columns // 4),
            [src.reshape(flat), taps, height, columns // 4, border, cval],
            [dst.reshape(flat)],
        )
    else:
        launch(columns1, src.shape, [src, taps, border, cval], [dst])


def correlate_rows(
    src: wp.array, taps: wp.array, step: int, border: int, cval: float, dst: wp.array
) -> None:
    """Correlate a (P, H, W step) array along its columns."""
    planes, height, columns = src.shape
    if step == 1 and _in_quads(src, dst):
        flat = (src.size,)
        launch(
            rows4,
            (planes * height, columns // 4),
            [src.reshape(flat), taps, columns // 4, border, cval],
            [dst.reshape(flat)],
        )
    else:
        launch(rows1, src.shape, [src, taps, step, border, cval], [dst])


def _in_quads(*arrays: wp.array) -> bool:
    """Tell whether every row of the arrays falls into aligned groups of four floats."""
    return all(a.shape[-1] % 4 == 0 and a.ptr % 16 == 0 for a in arrays)
