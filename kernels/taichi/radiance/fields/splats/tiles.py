"""Splats composited tile by tile, front to back, in Taichi.

At a pixel, splat i of the tile's list has the opacity alpha_i = min(o_i exp(e_i), 0.99), where
e = -(A dx^2 + C dy^2) / 2 - B dx dy, and is left out below 1 / 255. With T_i = prod_{j < i}
(1 - alpha_j) and w_i = T_i alpha_i,

    C = sum w_i c_i,    O = sum w_i,    D = sum w_i t_i,

and a ray ends where T_i falls to `stop`. For gradients g by C and O,

    dL/dc_i = w_i g_C,    dL/de_i = alpha_i (T_i (<g_C, c_i> + g_O) - S_i / (1 - alpha_i)),
    S_i = sum_{j > i} w_j (<g_C, c_j> + g_O),

which is 0 where the opacity is the largest one, and the end of a ray is constant. S_i is what is
left of <g_C, C> + g_O O after the splats up to i. From dL/de_i follow the gradients by o, the
place, and A, B, C. They are added over the pixels of a tile, column by column, each from the top.

Forward, one thread per pixel; backward, one per tile, since sums have an order.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance
from cvkern.kernels.codes import splats as codes
from cvkern.kernels.codes.splats import FAINT, MOST, SLOPES, TILE
from cvkern.kernels.taichi._launch import primitive, scratch

from ._placing import exponential

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
sums_type = ti.types.vector(SLOPES, ti.f32)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def _alpha(shown: ti.template(), n: ti.i32, dx: ti.f32, dy: ti.f32) -> ti.f32:
    """Return the opacity of a splat at a pixel."""
    a, b, c = shown[n, 2], shown[n, 3], shown[n, 4]
    e = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy
    return ti.min(shown[n, 5] * exponential(ti.min(e, 0.0)), MOST)


@ti.kernel
def _composite(
    shown: f32_2,  # (N, 12)
    entries: i32_1,  # (E,)
    ranges: i32_1,  # (T + 1,)
    width: ti.i32,
    height: ti.i32,
    stop: ti.f32,
    # outputs
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depths: f32_1,  # (R,)
):
    for row, column in ti.ndrange(height, width):
        tile = row // TILE * ((width + TILE - 1) // TILE) + column // TILE
        color, depth, through = vec3(0.0), 0.0, 1.0
        place, end = ranges[tile], ranges[tile + 1]
        while place < end and through > stop:
            n = entries[place]
            dx, dy = shown[n, 0] - column, shown[n, 1] - row
            if ti.abs(dy) <= shown[n, 11]:
                alpha = _alpha(shown, n, dx, dy)
                if alpha >= FAINT:
                    weight = through * alpha
                    for k in ti.static(range(3)):
                        color[k] += weight * shown[n, 6 + k]
                    depth += weight * shown[n, 9]
                    through -= weight
            place += 1
        ray = row * width + column
        for k in ti.static(range(3)):
            colors[ray, k] = color[k]
        opacity[ray] = 1.0 - through
        depths[ray] = depth


@primitive
def composite(tiles: codes.Tiles, seen: radiance.Seen) -> None:
    """Composite all pixels of a picture."""
    t = tiles
    _composite(t.shown, t.entries, t.ranges, t.width, t.height, t.stop, *seen)


@ti.kernel
def _begin(
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    # outputs
    lights: f32_2,  # (R, 2): T, and what is left of <g_C, C> + g_O O
):
    for ray in range(lights.shape[0]):
        total = 0.0
        for k in ti.static(range(3)):
            total += d_color[ray, k] * colors[ray, k]
        lights[ray, 0] = 1.0
        lights[ray, 1] = total + d_opacity[ray] * opacity[ray]


@ti.kernel
def _trace(
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    shown: f32_2,  # (N, 12)
    entries: i32_1,  # (E,)
    sources: i32_1,  # (E,)
    ranges: i32_1,  # (T + 1,)
    width: ti.i32,
    height: ti.i32,
    stop: ti.f32,
    # outputs
    lights: f32_2,  # (R, 2)
    slopes: f32_2,  # (E, 9)
):
    for tile in range(ranges.shape[0] - 1):
        across = (width + TILE - 1) // TILE
        top, left = tile // across * TILE, tile % across * TILE
        bottom, right = ti.min(top + TILE, height), ti.min(left + TILE, width)
        for place in range(ranges[tile], ranges[tile + 1]):
            n = entries[place]
            a, b, c = shown[n, 2], shown[n, 3], shown[n, 4]
            total = sums_type(0.0)
            for column in range(left, right):
                part = sums_type(0.0)
                dx = shown[n, 0] - column
                for row in range(top, bottom):
                    dy = shown[n, 1] - row
                    ray = row * width + column
                    through = lights[ray, 0]
                    if through > stop and ti.abs(dy) <= shown[n, 11]:
                        alpha = _alpha(shown, n, dx, dy)
                        if alpha >= FAINT:
                            weight = through * alpha
                            slope = (
                                d_color[ray, 0] * shown[n, 6]
                                + d_color[ray, 1] * shown[n, 7]
                                + d_color[ray, 2] * shown[n, 8]
                                + d_opacity[ray]
                            )
                            left_over = through - weight
                            rest = lights[ray, 1] - weight * slope
                            lights[ray, 0] = left_over
                            lights[ray, 1] = rest
                            shadow = 0.0
                            if left_over > stop:
                                shadow = rest / (1.0 - alpha)
                            d = 0.0
                            if alpha < MOST:
                                d = (through * slope - shadow) * alpha
                            part[0] -= (a * dx + b * dy) * d
                            part[1] -= (c * dy + b * dx) * d
                            part[2] -= 0.5 * dx * dx * d
                            part[3] -= dx * dy * d
                            part[4] -= 0.5 * dy * dy * d
                            part[5] += d
                            for k in ti.static(range(3)):
                                part[6 + k] += weight * d_color[ray, k]
                for k in ti.static(range(SLOPES)):
                    total[k] += part[k]
            for k in ti.static(range(SLOPES)):
                slopes[sources[place], k] = total[k]
            slopes[sources[place], 5] = total[5] / shown[n, 5]


@primitive
def composite_backward(
    d_seen: radiance.Seen, tiles: codes.Tiles, seen: radiance.Seen, slopes: np.ndarray
) -> None:
    """Compute the gradients of entries by the first numbers of `shown`, `slopes` (E, 9).

    `d_seen` are gradients by colours and opacities of `seen`; depths have none. The end of a ray is
    treated as constant.
    """
    lights = scratch((tiles.width * tiles.height, 2), np.float32)
    _begin(d_seen.color, d_seen.opacity, seen.color, seen.opacity, lights)
    _trace(d_seen.color, d_seen.opacity, *tiles, lights, slopes)
