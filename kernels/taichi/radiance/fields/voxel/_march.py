"""The walk of a ray through a grid of density and colour, in Taichi: see rays.py."""

import taichi as ti

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY, Draw
from cvkern.kernels.taichi._random import random_unit
from cvkern.kernels.taichi.radiance._fixed_point import add
from cvkern.kernels.taichi.radiance._harmonics import harmonics
from cvkern.kernels.taichi.radiance._space import (
    in_cube,
    interval,
    is_set,
    reciprocal,
    row,
    way_out,
)
from cvkern.kernels.taichi.radiance._structs import Grid, March

ZERO = 0  # the results need not have equal bits everywhere, so products may be fused with sums

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)
ivec3 = ti.types.vector(3, ti.i32)


@ti.func
def _corner(node: ivec3, corner: ti.template()):
    """Return the node (k, j, i) at a corner of a cell; the corner's bits tell its sides."""
    return node[2] + (corner >> 2), node[1] + (corner >> 1 & 1), node[0] + (corner & 1)


@ti.func
def _share(f: vec3, corner: ti.template()) -> ti.f32:
    """Return the weight of a corner, for a position in the cell from 0 to 1."""
    share = 1.0
    for k in ti.static(range(3)):
        share *= f[k] if ti.static(corner >> k & 1) else 1.0 - f[k]
    return share


@ti.kernel
def march_all(
    backward: ti.template(),
    serial: ti.template(),
    exact: ti.template(),
    d_colors: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_depth: f32_1,  # (R,)
    d_distortion: f32_1,  # (R,)
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    bits: u32_1,  # (cells^3 / 32,)
    march: March,
    grid: Grid,
    step: i32_1,  # (1,)
    density: f32_3,  # (N + 1, N + 1, N + 1)
    color: f32_4,  # (N + 1, N + 1, N + 1, C)
    # outputs of the forward pass, inputs of the backward pass
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depth: f32_1,  # (R,)
    distortion: f32_1,  # (R,)
    samples: i32_1,  # (R,)
    # outputs of the backward pass, int64 if exact
    d_density: ti.types.ndarray(ndim=3),
    d_color: ti.types.ndarray(ndim=4),
    touched: u8_3,
):
    ti.loop_config(serialize=serial)
    for ray in range(origins.shape[0]):
        if ray < active[0]:
            o = row(origins, ray)
            d = row(directions, ray)
            inverse = reciprocal(d, ZERO)
            h = harmonics(d[0], d[1], d[2])
            resolution = density.shape[0] - 1
            cells = march.cells
            size = resolution // cells
            t, last = march.near, march.far
            if not march.unbounded:
                inside = interval(o, inverse, 1.0, ZERO)
                t, last = ti.max(march.near, inside[0]), ti.min(march.far, inside[1])
            jitter = 0.5
            if march.jittered:
                jitter = random_unit(march.seed, step[0], ray, Draw.JITTER)
            t += jitter * ti.max(march.finest, march.cone * t)
            left, sum_w, sum_wt, spread, found = 1.0, 0.0, 0.0, 0.0, 0
            seen = vec3(0.0)
            # The backward pass has the gradients, and the sum of w_j G_j of the samples ahead.
            dc, do, dd, dx, rest = vec3(0.0), 0.0, 0.0, 0.0, 0.0
            if ti.static(backward):
                dc = row(d_colors, ray)
                do, dd, dx = d_opacity[ray], d_depth[ray], d_distortion[ray]
                rest = dc.dot(row(colors, ray)) + do * opacity[ray] + dd * depth[ray]
                rest += 2.0 * dx * distortion[ray]
            while t < last and left > grid.stop:
                gap = ti.max(march.finest, march.cone * t)
                point = o + t * d
                at = ti.math.clamp(in_cube(point, march.unbounded), 0.0, 1.0) * resolution
                node = ti.min(ti.cast(at, ti.i32), resolution - 1)
                f = at - node
                cell = node // size
                if is_set(bits, (cell[2] * cells + cell[1]) * cells + cell[0]):
                    raw = 0.0
                    for corner in ti.static(range(8)):
                        k, j, i = _corner(node, corner)
                        raw += _share(f, corner) * density[k, j, i]
                    if raw > grid.least:
                        sigma = ti.exp(ti.min(raw, MOST_LOG_DENSITY))
                        w = left * (1.0 - ti.exp(-sigma * gap))
                        s = vec3(0.0)
                        for corner in ti.static(range(8)):
                            share = _share(f, corner)
                            k, j, i = _corner(node, corner)
                            for n in ti.static(range(9)):
                                if n < grid.basis:
                                    for c in ti.static(range(3)):
                                        s[c] += share * h[n] * color[k, j, i, c * grid.basis + n]
                        rgb = 1.0 / (1.0 + ti.exp(-s))
                        left -= w
                        if ti.static(backward):
                            apart = t * sum_w - sum_wt
                            sum_w += w
                            sum_wt += w * t
                            apart += (depth[ray] - sum_wt) - t * (opacity[ray] - sum_w)
                            g = dc.dot(rgb) + do + dd * t
                            g += dx * (2.0 * apart + 2.0 / 3.0 * w * gap)
                            rest -= w * g
                            d_raw = sigma * gap * (left * g - rest)
                            d_s = w * dc * rgb * (1.0 - rgb)
                            for corner in ti.static(range(8)):
                                share = _share(f, corner)
                                k, j, i = _corner(node, corner)
                                touched[k, j, i] = ti.u8(1)
                                add(d_density[k, j, i], share * d_raw, exact)
                                for n in range(grid.basis):  # unrolled, compiles for a minute
                                    for c in ti.static(range(3)):
                                        v = share * h[n] * d_s[c]
                                        add(d_color[k, j, i, c * grid.basis + n], v, exact)
                        else:
                            seen += w * rgb
                            spread += w * (2.0 * (t * sum_w - sum_wt) + w * gap / 3.0)
                            sum_w += w
                            sum_wt += w * t
                            found += 1
                    t += gap
                elif march.unbounded:
                    t += gap
                else:  # whole steps to a position after the cell
                    t += gap * ti.max(1.0, ti.ceil(way_out(point, inverse, 0, cells, ZERO) / gap))
            if ti.static(not backward):
                for c in ti.static(range(3)):
                    colors[ray, c] = seen[c]
                opacity[ray], depth[ray], distortion[ray] = sum_w, sum_wt, spread
                samples[ray] = found
        elif ti.static(not backward):
            samples[ray] = 0
