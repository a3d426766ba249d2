"""A bilateral grid, in Warp; the Taichi set has the rules.

On the CPU one thread fills a row of cells; on CUDA a block fills those of one place.
"""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each
from cvkern.kernels.warp.raw import _grids_cuda, _tone_cuda
from cvkern.kernels.warp.raw._sums_cpu import add_up

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_STEPS = wp.constant(float(codes.STEPS))


def fill(
    logs: wp.array,
    lowest: float,
    space: float,
    depth: float,
    taps: wp.array,
    cells: wp.array,
    out: wp.array,
) -> None:
    """Add values and their number to the nearest of (Y, X, Z, 2) cells; smooth along Z into `out`.

    Cells are 0 before, and on CUDA afterwards.
    """
    rows, columns = cells.shape[:2]
    inputs = [logs, lowest, space, depth]
    if out.device.is_cuda:
        launch(_grids_cuda.fill_cells, rows * columns * BLOCK, [*inputs, taps], [out])
        return
    launch_each(_fill, rows, 2 * logs.size, inputs, [cells])
    launch_each(_smooth_depth, out.size, 9 * out.size, [cells, taps], [out])


def smooth(src: wp.array, taps: wp.array, between: wp.array, out: wp.array) -> None:
    """Smooth along Y, into `between`, then along X."""
    launch_each(_smooth, out.size, 9 * out.size, [src, taps, 0], [between])
    launch_each(_smooth, out.size, 9 * out.size, [between, taps, 1], [out])


def read(
    logs: wp.array,
    cells: wp.array,
    lowest: float,
    space: float,
    depth: float,
    out: wp.array,
    sums: wp.array,
) -> None:
    """Write the mean of the cells around each pixel and its value, and measure these means."""
    inputs = [logs, cells, lowest, space, depth]
    if out.device.is_cuda:
        groups = out.shape[0] * -(-out.shape[1] // 4)
        launch(_grids_cuda.read_four, _tone_cuda.threads(groups), inputs, [out, sums])
        return
    launch_each(_read, out.size, 20 * out.size, inputs, [out])
    add_up(out, sums)


@wp.func
def _add(cells: wp.array4d[wp.int64], y: int, x: int, z: int, value: wp.int64, count: wp.int64):
    if count > wp.int64(0):
        wp.atomic_add(cells, y, x, z, 0, value)
        wp.atomic_add(cells, y, x, z, 1, count)


@wp.kernel
def _fill(
    stride: int,
    first: int,
    last: int,
    logs: wp.array2d[float],
    lowest: float,
    space: float,
    depth: float,
    # outputs
    cells: wp.array4d[wp.int64],
):
    height = logs.shape[0]
    width = logs.shape[1]
    for item in range(first + wp.tid(), last, stride):
        # The rows of pixels that a row of cells adds up, at least.
        top = int((float(item) - 3.0) / space)
        bottom = int((float(item) - 1.0) / space)
        for y in range(wp.max(top, 0), wp.min(bottom, height - 1) + 1):
            if int(float(y) * space + 2.5) == item:
                value = wp.int64(0)
                count = wp.int64(0)
                at = int(0)
                z = int(0)
                for x in range(width):
                    here = int(float(x) * space + 2.5)
                    deep = int((logs[y, x] - lowest) * depth + 2.5)
                    if deep != z or here != at:
                        _add(cells, item, at, z, value, count)
                        value = wp.int64(0)
                        count = wp.int64(0)
                        z = deep
                        at = here
                    value += wp.int64(wp.floor((logs[y, x] - lowest) * _STEPS + 0.5))
                    count += wp.int64(1)
                _add(cells, item, at, z, value, count)


@wp.kernel
def _smooth_depth(
    stride: int,
    first: int,
    last: int,
    cells: wp.array4d[wp.int64],
    taps: wp.array[float],
    # outputs
    out: wp.array4d[float],
):
    size = cells.shape[2]
    for i in range(first + wp.tid(), last, stride):
        part = i % 2
        z = i // 2 % size
        x = i // 2 // size % cells.shape[1]
        y = i // 2 // size // cells.shape[1]
        total = float(0.0)
        for t in range(taps.shape[0]):
            u = z + t - taps.shape[0] // 2
            if u >= 0 and u < size:
                total += taps[t] * float(cells[y, x, u, part])
        out[y, x, z, part] = total


@wp.kernel
def _smooth(
    stride: int,
    first: int,
    last: int,
    src: wp.array4d[float],
    taps: wp.array[float],
    axis: int,
    # outputs
    out: wp.array4d[float],
):
    for i in range(first + wp.tid(), last, stride):
        part = i % 2
        z = i // 2 % src.shape[2]
        x = i // 2 // src.shape[2] % src.shape[1]
        y = i // 2 // src.shape[2] // src.shape[1]
        total = float(0.0)
        for t in range(taps.shape[0]):
            v = y
            u = x
            if axis == 0:
                v = y + t - taps.shape[0] // 2
            else:
                u = x + t - taps.shape[0] // 2
            if v >= 0 and v < src.shape[0] and u >= 0 and u < src.shape[1]:
                total += taps[t] * src[v, u, z, part]
        out[y, x, z, part] = total


@wp.func
def _near(cells: wp.array4d[float], y: int, x: int, z: int, fx: float, fz: float, part: int):
    a = cells[y, x, z, part] + fz * (cells[y, x, z + 1, part] - cells[y, x, z, part])
    b = cells[y, x + 1, z, part] + fz * (cells[y, x + 1, z + 1, part] - cells[y, x + 1, z, part])
    return a + fx * (b - a)


@wp.kernel
def _read(
    stride: int,
    first: int,
    last: int,
    logs: wp.array2d[float],
    cells: wp.array4d[float],
    lowest: float,
    space: float,
    depth: float,
    # outputs
    out: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        row = i // logs.shape[1]
        column = i - row * logs.shape[1]
        y = float(row) * space + 2.0
        x = float(column) * space + 2.0
        z = (logs[row, column] - lowest) * depth + 2.0
        fy = y - float(int(y))
        fx = x - float(int(x))
        fz = z - float(int(z))
        sums = wp.vec2()
        for part in range(2):
            a = _near(cells, int(y), int(x), int(z), fx, fz, part)
            b = _near(cells, int(y) + 1, int(x), int(z), fx, fz, part)
            sums[part] = a + fy * (b - a)
        out[row, column] = lowest + sums[0] / (wp.max(sums[1], 1.0e-12) * _STEPS)
