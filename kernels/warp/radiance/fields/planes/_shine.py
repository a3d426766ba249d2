"""Colours of planes that depend on the side from which they are seen, in Warp."""

import warp as wp

from ._path import Corner, Path

wp.set_module_options({"enable_backward": False})

WIDEST = wp.constant(1.5)  # most units of an offset, for cameras far from the photographs


@wp.struct
class Shine:
    """Coefficients of the functions of the side."""

    maps: wp.array4d[float]  # (G, h, w, 3 N)
    shared: int
    reach: float


@wp.struct
class Place:
    """The upper left of the four coefficients around a point, and the point's offset."""

    row: int
    column: int
    down: float
    right: float


@wp.func
def place_of(shine: Shine, at: Corner) -> Place:
    """Return the place of a point among the coefficients, every second texel."""
    row = 0.5 * (float(at.row) + at.down)
    column = 0.5 * (float(at.column) + at.right)
    place = Place()
    place.row = wp.min(int(row), shine.maps.shape[1] - 2)
    place.column = wp.min(int(column), shine.maps.shape[2] - 2)
    place.down = row - float(place.row)
    place.right = column - float(place.column)
    return place


@wp.func
def side_of(shine: Shine, path: Path, disparity: float, function: int) -> float:
    """Return the value of a function of the side: x, y, x^2, x y, y^2."""
    scale = disparity / shine.reach
    x = wp.clamp(path.right * scale, -WIDEST, WIDEST)
    y = wp.clamp(path.down * scale, -WIDEST, WIDEST)
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


@wp.func
def shift_of(shine: Shine, path: Path, disparity: float, plane: int, at: Corner) -> wp.vec3:
    """Return the change of the colour of a point by the side from which it is seen."""
    group = plane // shine.shared
    place = place_of(shine, at)
    i = place.row
    j = place.column
    total = wp.vec3(0.0, 0.0, 0.0)
    for n in range(shine.maps.shape[3] // 3):
        side = side_of(shine, path, disparity, n)
        for c in range(3):
            k = 3 * n + c
            upper = wp.lerp(shine.maps[group, i, j, k], shine.maps[group, i, j + 1, k], place.right)
            lower = wp.lerp(
                shine.maps[group, i + 1, j, k], shine.maps[group, i + 1, j + 1, k], place.right
            )
            total[c] = total[c] + side * wp.lerp(upper, lower, place.down)
    return total
