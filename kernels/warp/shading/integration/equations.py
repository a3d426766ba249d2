"""Equations of the edges between pixels, from normals, in Warp.

The Taichi set has the equations. One thread has a pixel, on the CPU in slabs.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp.shading._mask import is_inside
from cvkern.kernels.warp.shading._rows import launch_rows

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)


def slopes(
    normals: wp.array,
    mask: wp.array,
    flattest: float,
    inside: wp.array,
    slope: wp.array,
    cut: wp.array,
) -> None:
    """Write where normals face the camera, and there their slopes of depth and their z.

    `cut` (1,) becomes 1 if there is a pixel outside, and stays as it is otherwise.
    """
    inputs = [normals, mask, flattest]
    launch_rows(_slopes, inside.shape, 4, inputs, [inside, slope, cut])


@wp.kernel
def _slopes(
    stride: int,
    first: int,
    last: int,
    run: int,
    normals: wp.array3d[float],
    mask: wp.array2d[wp.uint8],
    flattest: float,
    # outputs
    inside: wp.array2d[wp.uint8],
    slope: wp.array3d[float],  # (3, H, W): along columns, down the rows, z of the unit normal
    cut: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // inside.shape[1]
        begin = i * run % inside.shape[1]
        for x in range(begin, begin + run):
            nx = normals[y, x, 0]
            ny = normals[y, x, 1]
            nz = normals[y, x, 2]
            length = wp.sqrt(nx * nx + ny * ny + nz * nz)
            found = is_inside(mask, y, x) and wp.isfinite(length) and nz > 0.0
            inside[y, x] = wp.where(found, wp.uint8(1), wp.uint8(0))
            a = float(0.0)
            b = float(0.0)
            c = float(0.0)
            if found:
                c = wp.max(nz / length, flattest)
                a = nx / length / c
                b = (0.0 - ny) / length / c
            else:
                cut[0] = 1
            slope[0, y, x] = a
            slope[1, y, x] = b
            slope[2, y, x] = c


@wp.func
def _there(inside: wp.array2d[wp.uint8], y: int, x: int) -> bool:
    found = bool(False)
    if y >= 0 and x >= 0 and y < inside.shape[0] and x < inside.shape[1]:
        found = inside[y, x] != wp.uint8(0)
    return found


@wp.func
def _bend(slope: wp.array3d[float], axis: int, y: int, x: int, k: int) -> float:
    """Return the second difference of slopes k pixels apart."""
    own = slope[axis, y, x]
    before = slope[axis, y - axis * k, x - (1 - axis) * k]
    after = slope[axis, y + axis * k, x + (1 - axis) * k]
    return (before - own) + (after - own)


def adjust(inside: wp.array, slope: wp.array, adjusted: wp.array) -> None:
    """Write slopes such that the mean of two neighbours is the rise between them."""
    launch_rows(_adjust, inside.shape, 16, [inside, slope], [adjusted])


@wp.kernel
def _adjust(
    stride: int,
    first: int,
    last: int,
    run: int,
    inside: wp.array2d[wp.uint8],
    slope: wp.array3d[float],
    # outputs
    adjusted: wp.array3d[float],  # (2, H, W)
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // inside.shape[1]
        begin = i * run % inside.shape[1]
        for x in range(begin, begin + run):
            for axis in range(2):
                v = axis
                u = 1 - axis
                here = inside[y, x] != wp.uint8(0)
                before = here and _there(inside, y - v, x - u)
                after = here and _there(inside, y + v, x + u)
                more_before = before and _there(inside, y - 2 * v, x - 2 * u)
                more_after = after and _there(inside, y + 2 * v, x + 2 * u)
                curve = float(0.0)
                if more_before and more_after:
                    curve = _bend(slope, axis, y, x, 2) - 3.0 * _bend(slope, axis, y, x, 1)
                elif before and after:
                    curve = _bend(slope, axis, y, x, 1)
                elif more_before:
                    curve = _bend(slope, axis, y - v, x - u, 1)
                elif more_after:
                    curve = _bend(slope, axis, y + v, x + u, 1)
                adjusted[axis, y, x] = slope[axis, y, x] - curve / 12.0


@wp.func
def _difference(
    depth: wp.array2d[wp.float64], inside: wp.array2d[wp.uint8], y: int, x: int, v: int, u: int
):
    """Return the depth at (v, u) less that at (y, x), 0 where one of them is outside."""
    found = wp.float64(0.0)
    if v >= 0 and u >= 0 and v < inside.shape[0] and u < inside.shape[1]:
        if inside[y, x] != wp.uint8(0) and inside[v, u] != wp.uint8(0):
            found = depth[v, u] - depth[y, x]
    return found


@wp.func
def _side(before: wp.float64, after: wp.float64, z: float, sharpness: float):
    """Return the share of the difference to the pixel after: more, the smaller it is."""
    a = wp.float64(z) * before
    b = wp.float64(z) * after
    e = wp.clamp(wp.float64(sharpness) * (a * a - b * b), wp.float64(-30.0), wp.float64(30.0))
    return float(wp.float64(1.0) / (wp.float64(1.0) + wp.exp(-e)))


def sides(
    depth: wp.array, inside: wp.array, slope: wp.array, sharpness: float, shares: wp.array
) -> None:
    """Write on which side of a pixel its surface goes on: right, and below."""
    inputs = [depth, inside, slope, sharpness]
    launch_rows(_sides, inside.shape, 32, inputs, [shares])


@wp.kernel
def _sides(
    stride: int,
    first: int,
    last: int,
    run: int,
    depth: wp.array2d[wp.float64],
    inside: wp.array2d[wp.uint8],
    slope: wp.array3d[float],
    sharpness: float,
    # outputs
    shares: wp.array3d[float],  # (2, H, W)
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // inside.shape[1]
        begin = i * run % inside.shape[1]
        for x in range(begin, begin + run):
            z = slope[2, y, x]
            left = _difference(depth, inside, y, x, y, x - 1)
            right = _difference(depth, inside, y, x, y, x + 1)
            above = _difference(depth, inside, y, x, y - 1, x)
            below = _difference(depth, inside, y, x, y + 1, x)
            shares[0, y, x] = _side(left, right, z, sharpness)
            shares[1, y, x] = _side(above, below, z, sharpness)


def join(
    inside: wp.array, slope: wp.array, shares: wp.array, weights: wp.array, rises: wp.array
) -> None:
    """Write the weight and the weighted rise of the edge to the right and of that below.

    Without shares, of shape (0, 1, 1), all weights are 1.
    """
    inputs = [inside, slope, shares]
    launch_rows(_join, inside.shape, 16, inputs, [weights, rises])


@wp.kernel
def _join(
    stride: int,
    first: int,
    last: int,
    run: int,
    inside: wp.array2d[wp.uint8],
    slope: wp.array3d[float],
    shares: wp.array3d[float],
    # outputs
    weights: wp.array3d[float],  # (2, H, W)
    rises: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // inside.shape[1]
        begin = i * run % inside.shape[1]
        for x in range(begin, begin + run):
            for axis in range(2):
                v = y + axis
                u = x + 1 - axis
                weight = float(0.0)
                rise = float(0.0)
                if v < inside.shape[0] and u < inside.shape[1]:
                    if inside[y, x] != wp.uint8(0) and inside[v, u] != wp.uint8(0):
                        a = float(0.5)
                        b = float(0.5)
                        if shares.shape[0] > 0:
                            a = shares[axis, y, x] * slope[2, y, x] * slope[2, y, x]
                            b = (1.0 - shares[axis, v, u]) * slope[2, v, u] * slope[2, v, u]
                        weight = a + b
                        rise = a * slope[axis, y, x] + b * slope[axis, v, u]
                weights[axis, y, x] = weight
                rises[axis, y, x] = rise


@wp.func
def _edge(
    weights: wp.array3d[float], rises: wp.array3d[float], z: wp.array2d[wp.float64],
    axis: int, y: int, x: int,
):  # fmt: skip
    """Return the pull of an edge: its weight times the error of the rise of z."""
    weight = weights[axis, y, x]
    pull = wp.float64(0.0)
    if weight > 0.0:
        rise = z[y + axis, x + 1 - axis] - z[y, x]
        pull = wp.float64(weight) * rise
        if rises.shape[0] > 0:
            pull = pull - wp.float64(rises[axis, y, x])
    return pull


def pull(weights: wp.array, rises: wp.array, z: wp.array, sign: float, out: wp.array) -> None:
    """Write the sum of the pulls of the edges of each pixel, times a sign.

    With the rises and sign 1 that is what is left of the equations; without, of shape (0, 1, 1),
    and sign -1, the product of their matrix and z.
    """
    launch_rows(_pull, z.shape, 16, [weights, rises, z, sign], [out])


@wp.kernel
def _pull(
    stride: int,
    first: int,
    last: int,
    run: int,
    weights: wp.array3d[float],
    rises: wp.array3d[float],
    z: wp.array2d[wp.float64],
    sign: float,
    # outputs
    out: wp.array2d[wp.float64],
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // z.shape[1]
        begin = i * run % z.shape[1]
        for x in range(begin, begin + run):
            total = _edge(weights, rises, z, 0, y, x) + _edge(weights, rises, z, 1, y, x)
            if x > 0:
                total = total - _edge(weights, rises, z, 0, y, x - 1)
            if y > 0:
                total = total - _edge(weights, rises, z, 1, y - 1, x)
            out[y, x] = wp.float64(sign) * total


def weigh_misfit(
    depth: wp.array, inside: wp.array, slope: wp.array, shares: wp.array, rows: wp.array
) -> None:
    """Write the energy of each row: the weighted squares of the residuals of equations."""
    inputs = [depth, inside, slope, shares]
    launch_each(_weigh_misfit, rows.size, 32 * inside.size, inputs, [rows])


@wp.kernel
def _weigh_misfit(
    stride: int,
    first: int,
    last: int,
    depth: wp.array2d[wp.float64],
    inside: wp.array2d[wp.uint8],
    slope: wp.array3d[float],
    shares: wp.array3d[float],
    # outputs
    rows: wp.array[wp.float64],
):
    for y in range(first + wp.tid(), last, stride):
        total = wp.float64(0.0)
        for x in range(inside.shape[1]):
            for axis in range(2):
                v = y + axis
                u = x + 1 - axis
                if v < inside.shape[0] and u < inside.shape[1]:
                    if inside[y, x] != wp.uint8(0) and inside[v, u] != wp.uint8(0):
                        rise = depth[v, u] - depth[y, x]
                        a = rise - wp.float64(slope[axis, y, x])
                        b = rise - wp.float64(slope[axis, v, u])
                        za = wp.float64(slope[2, y, x])
                        zb = wp.float64(slope[2, v, u])
                        total += wp.float64(shares[axis, y, x]) * za * za * a * a
                        total += wp.float64(1.0 - shares[axis, v, u]) * zb * zb * b * b
        rows[y] = total


def finish(z: wp.array, parts: wp.array, means: wp.array, depth: wp.array) -> None:
    """Write depth in float32, less the mean of each part, NaN in part 0."""
    launch_rows(_finish, z.shape, 2, [z, parts, means], [depth])


@wp.kernel
def _finish(
    stride: int,
    first: int,
    last: int,
    run: int,
    z: wp.array2d[wp.float64],
    parts: wp.array2d[int],
    means: wp.array[wp.float64],
    # outputs
    depth: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // z.shape[1]
        begin = i * run % z.shape[1]
        for x in range(begin, begin + run):
            depth[y, x] = wp.nan
            if parts[y, x] > 0:
                depth[y, x] = float(z[y, x] - means[parts[y, x]])
