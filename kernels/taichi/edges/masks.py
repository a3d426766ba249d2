"""Thinning and hysteresis, in Taichi: one thread per pixel in each step.

Thinning keeps a pixel if it is a maximum along the gradient. Hysteresis keeps a pixel above the
lower threshold if it is connected with one above the higher threshold (Canny, "A computational
approach to edge detection", TPAMI 1986). Products are rounded before sums (`zero`, see
_rounding.py).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.edges import SECTOR_HIGH, SECTOR_LOW, SECTOR_ONE, Edge, Norm, Thinning
from cvkern.kernels.taichi._borders import border_index
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import squared_magnitude
from cvkern.kernels.taichi._rounding import product, root

from ._hysteresis import keep, plant, unite

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)  # (images, rows, columns)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@ti.func
def _pixel(
    src: ti.template(), n: ti.i32, y: ti.i32, x: ti.i32, border: ti.i32, cval: ti.f32
) -> ti.f32:
    j = border_index(y, src.shape[1], border)
    i = border_index(x, src.shape[2], border)
    v = cval
    if j >= 0 and i >= 0:
        v = ti.cast(src[n, j, i], ti.f32)
    return v


@ti.kernel
def _sobel(
    src: u8_3,
    border: ti.i32,
    cval: ti.f32,
    # outputs
    dy: f32_3,
    dx: f32_3,
):
    for n, y, x in src:
        north_west = _pixel(src, n, y - 1, x - 1, border, cval)
        north = _pixel(src, n, y - 1, x, border, cval)
        north_east = _pixel(src, n, y - 1, x + 1, border, cval)
        west = _pixel(src, n, y, x - 1, border, cval)
        east = _pixel(src, n, y, x + 1, border, cval)
        south_west = _pixel(src, n, y + 1, x - 1, border, cval)
        south = _pixel(src, n, y + 1, x, border, cval)
        south_east = _pixel(src, n, y + 1, x + 1, border, cval)
        dx[n, y, x] = (north_east - north_west) + 2.0 * (east - west) + (south_east - south_west)
        dy[n, y, x] = (south_west - north_west) + 2.0 * (south - north) + (south_east - north_east)


@ti.func
def _measure(
    dy: ti.template(),
    dx: ti.template(),
    n: ti.i32,
    y: ti.i32,
    x: ti.i32,
    norm: ti.i32,
    zero: ti.i32,
) -> ti.f32:
    """Return |dx| + |dy| or dx^2 + dy^2 at a pixel; 0 outside the image."""
    m = 0.0
    if 0 <= y < dy.shape[1] and 0 <= x < dy.shape[2]:
        if norm == Norm.L1:
            m = ti.abs(dx[n, y, x]) + ti.abs(dy[n, y, x])
        else:
            m = squared_magnitude(dy[n, y, x], dx[n, y, x], zero)
    return m


@ti.func
def _length(
    dy: ti.template(),
    dx: ti.template(),
    n: ti.i32,
    y: ti.i32,
    x: ti.i32,
    norm: ti.i32,
    zero: ti.i32,
) -> ti.f32:
    """Return the length of the gradient at a pixel; 0 outside the image."""
    m = _measure(dy, dx, n, y, x, norm, zero)
    if norm == Norm.L2:
        m = root(m, zero)
    return m


@ti.func
def _is_maximum_in_sector(
    dy: ti.template(),
    dx: ti.template(),
    n: ti.i32,
    y: ti.i32,
    x: ti.i32,
    norm: ti.i32,
    zero: ti.i32,
) -> ti.i32:
    """Tell whether a pixel is a maximum along the nearest of four directions, as in OpenCV."""
    gy = dy[n, y, x]
    gx = dx[n, y, x]
    sy = 0  # the step to the neighbour ahead
    sx = 1
    tie = 1  # whether an equal neighbour ahead is allowed
    if ti.abs(gy) * SECTOR_ONE >= ti.abs(gx) * SECTOR_LOW:
        sy = 1
        sx = 0
        if ti.abs(gy) * SECTOR_ONE <= ti.abs(gx) * SECTOR_HIGH:
            tie = 0
            sx = 1
            if (gx < 0.0) != (gy < 0.0):
                sx = -1
    m = _measure(dy, dx, n, y, x, norm, zero)
    ahead = _measure(dy, dx, n, y + sy, x + sx, norm, zero)
    return m > _measure(dy, dx, n, y - sy, x - sx, norm, zero) and (
        m > ahead or (tie == 1 and m == ahead)
    )


@ti.func
def _is_maximum_along_gradient(
    dy: ti.template(),
    dx: ti.template(),
    n: ti.i32,
    y: ti.i32,
    x: ti.i32,
    norm: ti.i32,
    framed: ti.i32,  # whether two equal neighbours are both maxima, as in scikit-image
    zero: ti.i32,
) -> ti.i32:
    """Tell whether a pixel is a maximum along its gradient, by interpolation (Canny 1986)."""
    gy = dy[n, y, x]
    gx = dx[n, y, x]
    s = 1
    if (gx < 0.0) != (gy < 0.0):
        s = -1
    big = ti.abs(gx)
    small = ti.abs(gy)
    sy = 0  # the step to the nearer neighbour ahead
    sx = 1
    if ti.abs(gy) > ti.abs(gx):
        big = ti.abs(gy)
        small = ti.abs(gx)
        sy = 1
        sx = 0
    # The other neighbour ahead is the diagonal one, (1, s) or (s, 1).
    ty = 1 if sy == 1 else s
    tx = s if sy == 1 else 1
    back = product(_length(dy, dx, n, y - sy, x - sx, norm, zero), big - small, zero) + product(
        _length(dy, dx, n, y - ty, x - tx, norm, zero), small, zero
    )
    ahead = product(_length(dy, dx, n, y + sy, x + sx, norm, zero), big - small, zero) + product(
        _length(dy, dx, n, y + ty, x + tx, norm, zero), small, zero
    )
    m = _length(dy, dx, n, y, x, norm, zero) * big
    first = m > back or (framed == 1 and m == back)
    return first and m >= ahead


@ti.kernel
def _thin(
    dy: f32_3,
    dx: f32_3,
    norm: ti.i32,
    rule: ti.i32,
    limits: f32_1,
    zero: ti.i32,
    # outputs
    states: u8_3,
):
    for n, y, x in dy:
        at = ti.min(2 * n, limits.shape[0] - 2)
        state = ti.cast(Edge.NONE, ti.i32)
        m = _measure(dy, dx, n, y, x, norm, zero)
        framed = rule == Thinning.FRAMED
        inside = 0 < y < dy.shape[1] - 1 and 0 < x < dy.shape[2] - 1
        if m > limits[at] and (inside or not framed):
            top = 0
            if rule == Thinning.SECTORS:
                top = _is_maximum_in_sector(dy, dx, n, y, x, norm, zero)
            else:
                top = _is_maximum_along_gradient(
                    dy, dx, n, y, x, norm, ti.cast(framed, ti.i32), zero
                )
            if top != 0:
                state = Edge.WEAK
                if m > limits[at + 1]:
                    state = Edge.STRONG
        states[n, y, x] = ti.cast(state, ti.u8)


@primitive
def thin(
    dy: np.ndarray,
    dx: np.ndarray,
    norm: int,
    rule: int,
    limits: np.ndarray,
    states: np.ndarray,
) -> None:
    """Mark the maxima along the gradient as weak or strong; one thread per pixel.

    Arrays are (H, W), or (N, H, W) of a stack; there are two limits for all images, or for each.
    """
    planes = (1, *dy.shape)[-3:]
    down, along, marked = (a.reshape(planes) for a in (dy, dx, states))
    _thin(down, along, norm, rule, limits, 0, marked)


@ti.kernel
def _fill_limits(
    low: ti.f32,
    high: ti.f32,
    # outputs
    limits: f32_1,
):
    limits[0] = low
    limits[1] = high


@primitive
def thin_sobel(
    src: np.ndarray,
    border: int,
    cval: float,
    norm: int,
    low: float,
    high: float,
    states: np.ndarray,
) -> None:
    """Differentiate with Sobel's kernels, then thin by sectors; one thread per pixel and step."""
    planes = (1, *src.shape)[-3:]
    dy = scratch(planes, np.float32)
    dx = scratch(planes, np.float32)
    _sobel(src.reshape(planes), border, cval, dy, dx)
    limits = scratch((2,), np.float32)
    _fill_limits(low, high, limits)
    _thin(dy, dx, norm, Thinning.SECTORS, limits, 0, states.reshape(planes))


@primitive
def hysteresis(states: np.ndarray, mask: np.ndarray) -> None:
    """Keep the pixels connected to a strong pixel; one thread per pixel in each of three steps."""
    planes = (1, *states.shape)[-3:]
    given, kept = states.reshape(planes), mask.reshape(planes)
    parents = scratch((states.size + 1,), np.int32)
    plant(given, parents)
    unite(given, parents)
    keep(given, parents, kept)
