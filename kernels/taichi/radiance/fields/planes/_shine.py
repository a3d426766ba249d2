"""Colours of planes that depend on the side from which they are seen, in Taichi."""

import taichi as ti

vec3 = ti.types.vector(3, ti.f32)

Rule = ti.types.struct(shared=ti.i32, reach=ti.f32, stop=ti.f32)
"""The planes that share coefficients, the unit of offsets, and the share of light at the end."""

WIDEST = 1.5  # most units of an offset, for cameras far from the photographs


@ti.func
def place_of(maps: ti.template(), at: ti.template()):
    """Return the upper left of the four coefficients around a point, and the point's offset."""
    row = 0.5 * (at.row + at.down)
    column = 0.5 * (at.column + at.right)
    i = ti.min(ti.cast(row, ti.i32), maps.shape[1] - 2)
    j = ti.min(ti.cast(column, ti.i32), maps.shape[2] - 2)
    return i, j, row - i, column - j


@ti.func
def side_of(path: ti.template(), disparity: ti.f32, reach: ti.f32, function: ti.i32) -> ti.f32:
    """Return the value of a function of the side: x, y, x^2, x y, y^2."""
    scale = disparity / reach
    x = ti.math.clamp(path.right * scale, -WIDEST, WIDEST)
    y = ti.math.clamp(path.down * scale, -WIDEST, WIDEST)
    found = x
    if function == 1:
        found = y
    elif function == 2:
        found = x * x
    elif function == 3:
        found = x * y
    elif function == 4:
        found = y * y
    return found


@ti.func
def shift_of(
    maps: ti.template(),
    rule: Rule,
    path: ti.template(),
    disparity: ti.f32,
    plane: ti.i32,
    at: ti.template(),
) -> vec3:
    """Return the change of the colour of a point by the side from which it is seen."""
    total = vec3(0.0)
    i, j, down, right = place_of(maps, at)
    group = plane // rule.shared
    for n in range(maps.shape[3] // 3):
        side = side_of(path, disparity, rule.reach, n)
        for c in ti.static(range(3)):
            k = 3 * n + c
            upper = (1.0 - right) * maps[group, i, j, k] + right * maps[group, i, j + 1, k]
            lower = (1.0 - right) * maps[group, i + 1, j, k] + right * maps[group, i + 1, j + 1, k]
            total[c] += side * ((1.0 - down) * upper + down * lower)
    return total
