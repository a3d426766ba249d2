"""Which image shows which pixel of a panorama, in Taichi.

Each image grows from its seeds: the pixels that only it covers, or where its weight is largest by
a margin. Fronts move slowly where images agree and fast where they differ. They therefore meet
where images agree, which hides the seam, and an object that moved is taken from one image. The
distance of a pixel is the cost of the shortest path from a seed [N. Gracias, M. Mahoor,
S. Negahdaripour and A. Gleason, "Fast image blending using watersheds and graph cuts", Image and
Vision Computing 27(5), 2009]; distances are integers, so the result does not depend on the order.

Images are parts (h, w) of a canvas. rects (N, 4) has the first column and row of each part, then
one past its last ones. Columns outside the canvas wrap around to its other end. One thread computes
one pixel unless stated otherwise.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.panorama import (
    FAR,
    LARGEST_COST,
    NOBODY,
    OUTSIDE,
    SLANTED,
    STRAIGHT,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
ROUNDS = 16  # steps in one call


@primitive
def compare(
    values: np.ndarray,
    weights: np.ndarray,
    rects: np.ndarray,
    gains: np.ndarray,
    sharpness: float,
    costs: np.ndarray,
    most: np.ndarray,
    second: np.ndarray,
) -> None:
    """Find the cost of a step at each pixel of the canvas, and the two largest weights there.

    The cost is 1 + 64 / (1 + (sharpness d)^2), d the largest range of a colour among the images
    that cover the pixel. One thread a pixel.
    """
    _compare(values, weights, rects, gains, sharpness, 0, costs, most, second)


@primitive
def seed(
    weights: np.ndarray,
    rects: np.ndarray,
    most: np.ndarray,
    second: np.ndarray,
    margin: float,
    distances: np.ndarray,
) -> None:
    """Write 0 where an image is alone or its weight exceeds all others by the margin, else `FAR`.

    The value is `OUTSIDE` where the image does not cover the pixel. One thread a pixel of an image.
    """
    _seed(weights, rects, most, second, margin, distances)


@primitive
def grow(costs: np.ndarray, rects: np.ndarray, distances: np.ndarray, changed: np.ndarray) -> None:
    """Lower distances to those of the eight neighbours plus the cost of a step.

    Set `changed` to 1 if further distances may fall: the caller repeats until none does. One thread
    a pixel. It may read old or new distances of its neighbours, because distances only fall.
    """
    for _ in range(ROUNDS):
        _grow(costs, rects, distances, changed)


@primitive
def choose(
    distances: np.ndarray, weights: np.ndarray, rects: np.ndarray, labels: np.ndarray
) -> None:
    """Assign each pixel of the canvas to the image with the least distance; ties go to the first.

    Where no front arrived, the largest weight wins. One thread a pixel.
    """
    _choose(distances, weights, rects, labels)


@ti.func
def _wrapped(x: ti.i32, width: ti.i32) -> ti.i32:
    """Return the column on the canvas; images begin less than one turn beside it."""
    place = x
    if x < 0:
        place = x + width
    elif x >= width:
        place = x - width
    return place


@ti.func
def _inside(rects: ti.template(), n: ti.i32, y: ti.i32, x: ti.i32, width: ti.i32):
    """Return row and column of a pixel of the canvas in image n, or -1."""
    i = y - rects[n, 1]
    j = x - rects[n, 0]
    if j >= width:
        j -= width
    if j < 0:
        j += width
    if y < rects[n, 1] or y >= rects[n, 3] or j < 0 or j >= rects[n, 2] - rects[n, 0]:
        i = -1
        j = -1
    return ti.Vector([i, j])


@ti.kernel
def _compare(
    values: f32_4,  # (N, C, h, w)
    weights: f32_3,  # (N, h, w)
    rects: i32_2,  # (N, 4)
    gains: f32_2,  # (N, C)
    sharpness: ti.f32,
    zero: ti.i32,
    # outputs
    costs: i32_2,  # (H, W)
    most: f32_2,
    second: f32_2,
):
    for y, x in costs:
        largest = 0.0
        other = 0.0
        for n in range(rects.shape[0]):
            at = _inside(rects, n, y, x, costs.shape[1])
            if at[0] >= 0:
                weight = weights[n, at[0], at[1]]
                if weight > largest:
                    other = largest
                    largest = weight
                elif weight > other:
                    other = weight
        apart = 0.0
        if other > 0.0:
            for c in range(values.shape[1]):
                low = ti.cast(ti.math.inf, ti.f32)
                high = -low
                for n in range(rects.shape[0]):
                    at = _inside(rects, n, y, x, costs.shape[1])
                    if at[0] >= 0:
                        if weights[n, at[0], at[1]] > 0.0:
                            value = product(gains[n, c], values[n, c, at[0], at[1]], zero)
                            low = ti.min(low, value)
                            high = ti.max(high, value)
                apart = ti.max(apart, high - low)
        d = sharpness * apart
        costs[y, x] = 1 + ti.cast(
            quotient(ti.cast(LARGEST_COST, ti.f32), 1.0 + product(d, d, zero), zero), ti.i32
        )
        most[y, x] = largest
        second[y, x] = other


@ti.kernel
def _seed(
    weights: f32_3,  # (N, h, w)
    rects: i32_2,
    most: f32_2,  # (H, W)
    second: f32_2,
    margin: ti.f32,
    # outputs
    distances: i32_3,  # (N, h, w)
):
    for n, i, j in distances:
        found = OUTSIDE
        if i < rects[n, 3] - rects[n, 1] and j < rects[n, 2] - rects[n, 0]:
            weight = weights[n, i, j]
            if weight > 0.0:
                y = i + rects[n, 1]
                x = _wrapped(j + rects[n, 0], most.shape[1])
                found = FAR
                if second[y, x] == 0.0 or (
                    weight == most[y, x] and weight - second[y, x] >= margin
                ):
                    found = 0
        distances[n, i, j] = found


@ti.kernel
def _grow(
    costs: i32_2,  # (H, W)
    rects: i32_2,
    # outputs
    distances: i32_3,  # (N, h, w)
    changed: i32_1,  # (1,)
):
    for n, i, j in distances:
        old = distances[n, i, j]
        if old > 0:
            cost = costs[i + rects[n, 1], _wrapped(j + rects[n, 0], costs.shape[1])]
            best = old
            for s, t in ti.static(ti.ndrange((-1, 2), (-1, 2))):
                u = i + s
                v = j + t
                if 0 <= u < distances.shape[1] and 0 <= v < distances.shape[2]:
                    beside = distances[n, u, v]
                    if beside >= 0:
                        length = ti.static(SLANTED if s != 0 and t != 0 else STRAIGHT)
                        best = ti.min(best, beside + length * cost)
            if best < old:
                distances[n, i, j] = best
                changed[0] = 1


@ti.kernel
def _choose(
    distances: i32_3,  # (N, h, w)
    weights: f32_3,
    rects: i32_2,
    # outputs
    labels: i32_2,  # (H, W)
):
    for y, x in labels:
        found = NOBODY
        least = FAR
        heaviest = 0.0
        for n in range(rects.shape[0]):
            at = _inside(rects, n, y, x, labels.shape[1])
            if at[0] >= 0:
                distance = distances[n, at[0], at[1]]
                weight = weights[n, at[0], at[1]]
                if distance >= 0 and (distance < least or (least == FAR and weight > heaviest)):
                    found = n
                    least = distance
                    heaviest = weight
        labels[y, x] = found
