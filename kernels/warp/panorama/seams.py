"""Which image shows which pixel of a panorama, in Warp.

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

import warp as wp

from cvkern.kernels.codes import panorama as codes
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NOBODY = wp.constant(codes.NOBODY)
FAR = wp.constant(codes.FAR)
OUTSIDE = wp.constant(codes.OUTSIDE)
STRAIGHT = wp.constant(codes.STRAIGHT)
SLANTED = wp.constant(codes.SLANTED)
LARGEST = wp.constant(float(codes.LARGEST_COST))
ROUNDS = 16  # steps on CUDA in one call


def compare(
    values: wp.array,
    weights: wp.array,
    rects: wp.array,
    gains: wp.array,
    sharpness: float,
    costs: wp.array,
    most: wp.array,
    second: wp.array,
) -> None:
    """Find the cost of a step at each pixel of the canvas, and the two largest weights there.

    The cost is 1 + 64 / (1 + (sharpness d)^2), d the largest range of a colour among the images
    that cover the pixel. One thread a pixel.
    """
    inputs = [values, weights, rects, gains, sharpness]
    count = costs.size
    launch_each(_compare, count, count * values.shape[0], inputs, [costs, most, second])


def seed(
    weights: wp.array,
    rects: wp.array,
    most: wp.array,
    second: wp.array,
    margin: float,
    distances: wp.array,
) -> None:
    """Write 0 where an image is alone or its weight exceeds all others by the margin, else `FAR`.

    The value is `OUTSIDE` where the image does not cover the pixel. One thread a pixel of an image.
    """
    inputs = [weights, rects, most, second, margin]
    launch_each(_seed, distances.size, distances.size, inputs, [distances])


def grow(costs: wp.array, rects: wp.array, distances: wp.array, changed: wp.array) -> None:
    """Lower distances to those of the eight neighbours plus the cost of a step.

    Set `changed` to 1 if further distances may fall: the caller repeats until none does. On the CPU
    a thread takes an image and sweeps over it until nothing changes. On CUDA it takes a pixel.
    """
    if distances.device.is_cuda:
        for _ in range(ROUNDS):
            launch(_grow, distances.size, [costs, rects], [distances, changed])
        return
    count = distances.shape[0]
    parts = max(1, min(count, slabs(count, distances.size)))
    launch_slabs(_sweep, count, parts, [costs, rects], [distances, changed])


def choose(distances: wp.array, weights: wp.array, rects: wp.array, labels: wp.array) -> None:
    """Assign each pixel of the canvas to the image with the least distance; ties go to the first.

    Where no front arrived, the largest weight wins. One thread a pixel.
    """
    inputs = [distances, weights, rects]
    launch_each(_choose, labels.size, labels.size * distances.shape[0], inputs, [labels])


@wp.func
def wrapped(x: int, width: int) -> int:
    """Return the column on the canvas; images begin less than one turn beside it."""
    if x < 0:
        return x + width
    if x >= width:
        return x - width
    return x


@wp.func
def inside(rects: wp.array2d[int], n: int, y: int, x: int, width: int) -> wp.vec2i:
    """Return row and column of a pixel of the canvas in image n, or -1."""
    if y < rects[n, 1] or y >= rects[n, 3]:
        return wp.vec2i(-1, -1)
    j = x - rects[n, 0]
    if j >= width:
        j -= width
    if j < 0:
        j += width
    if j < 0 or j >= rects[n, 2] - rects[n, 0]:
        return wp.vec2i(-1, -1)
    return wp.vec2i(y - rects[n, 1], j)


@wp.kernel
def _compare(
    stride: int,
    first: int,
    last: int,
    values: wp.array4d[float],  # (N, C, h, w)
    weights: wp.array3d[float],  # (N, h, w)
    rects: wp.array2d[int],  # (N, 4)
    gains: wp.array2d[float],  # (N, C)
    sharpness: float,
    # outputs
    costs: wp.array2d[int],  # (H, W)
    most: wp.array2d[float],
    second: wp.array2d[float],
):
    width = costs.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        largest = float(0.0)
        other = float(0.0)
        for n in range(rects.shape[0]):
            at = inside(rects, n, y, x, width)
            if at[0] >= 0:
                weight = weights[n, at[0], at[1]]
                if weight > largest:
                    other = largest
                    largest = weight
                elif weight > other:
                    other = weight
        apart = float(0.0)
        if other > 0.0:
            for c in range(values.shape[1]):
                low = float(wp.inf)
                high = float(-wp.inf)
                for n in range(rects.shape[0]):
                    at = inside(rects, n, y, x, width)
                    if at[0] >= 0:
                        if weights[n, at[0], at[1]] > 0.0:
                            value = gains[n, c] * values[n, c, at[0], at[1]]
                            low = wp.min(low, value)
                            high = wp.max(high, value)
                apart = wp.max(apart, high - low)
        d = sharpness * apart
        costs[y, x] = 1 + int(LARGEST / (1.0 + d * d))
        most[y, x] = largest
        second[y, x] = other


@wp.kernel
def _seed(
    stride: int,
    first: int,
    last: int,
    weights: wp.array3d[float],  # (N, h, w)
    rects: wp.array2d[int],
    most: wp.array2d[float],  # (H, W)
    second: wp.array2d[float],
    margin: float,
    # outputs
    distances: wp.array3d[int],  # (N, h, w)
):
    height = distances.shape[1]
    width = distances.shape[2]
    for item in range(first + wp.tid(), last, stride):
        line = item // width
        j = item - line * width
        n = line // height
        i = line - n * height
        found = int(OUTSIDE)
        if i < rects[n, 3] - rects[n, 1] and j < rects[n, 2] - rects[n, 0]:
            weight = weights[n, i, j]
            if weight > 0.0:
                y = i + rects[n, 1]
                x = wrapped(j + rects[n, 0], most.shape[1])
                found = int(FAR)
                if second[y, x] == 0.0 or (
                    weight == most[y, x] and weight - second[y, x] >= margin
                ):
                    found = 0
        distances[n, i, j] = found


@wp.func
def shortest(distances: wp.array3d[int], n: int, i: int, j: int, cost: int) -> int:
    """Return the least distance over the eight neighbours plus the cost of a step."""
    best = distances[n, i, j]
    for s in range(-1, 2):
        for t in range(-1, 2):
            u = i + s
            v = j + t
            if u >= 0 and v >= 0 and u < distances.shape[1] and v < distances.shape[2]:
                beside = distances[n, u, v]
                if beside >= 0:
                    length = wp.where(s != 0 and t != 0, int(SLANTED), int(STRAIGHT))
                    best = wp.min(best, beside + length * cost)
    return best


@wp.kernel
def _grow(
    costs: wp.array2d[int],  # (H, W)
    rects: wp.array2d[int],
    # outputs
    distances: wp.array3d[int],  # (N, h, w)
    changed: wp.array[int],  # (1,)
):
    item = wp.tid()
    height = distances.shape[1]
    width = distances.shape[2]
    line = item // width
    j = item - line * width
    n = line // height
    i = line - n * height
    old = distances[n, i, j]
    if old > 0:
        cost = costs[i + rects[n, 1], wrapped(j + rects[n, 0], costs.shape[1])]
        new = shortest(distances, n, i, j, cost)
        if new < old:
            distances[n, i, j] = new
            changed[0] = 1


@wp.func
def beside(
    distances: wp.array3d[int], n: int, i: int, j: int, s: int, t: int, best: int, step: int
) -> int:
    """Return the smaller of a distance and the distance through the neighbour (i + s, j + t)."""
    u = i + s
    v = j + t
    if u < 0 or v < 0 or u >= distances.shape[1] or v >= distances.shape[2]:
        return best
    there = distances[n, u, v]
    if there < 0:
        return best
    return wp.min(best, there + step)


@wp.kernel
def _sweep(
    slab: int,
    first: int,
    last: int,
    costs: wp.array2d[int],
    rects: wp.array2d[int],
    # outputs
    distances: wp.array3d[int],
    changed: wp.array[int],
):
    for n in range(first, last):
        height = rects[n, 3] - rects[n, 1]
        width = rects[n, 2] - rects[n, 0]
        count = height * width
        again = int(1)
        while again > 0:
            shorter = int(0)
            for item in range(2 * count):
                # Forward in raster order from the neighbours before; then backward from those
                # after.
                k = wp.where(item < count, item, 2 * count - 1 - item)
                side = wp.where(item < count, -1, 1)
                i = k // width
                j = k - i * width
                old = distances[n, i, j]
                if old > 0:
                    cost = costs[i + rects[n, 1], wrapped(j + rects[n, 0], costs.shape[1])]
                    straight = int(STRAIGHT) * cost
                    slanted = int(SLANTED) * cost
                    new = beside(distances, n, i, j, 0, side, old, straight)
                    new = beside(distances, n, i, j, side, 0, new, straight)
                    new = beside(distances, n, i, j, side, -1, new, slanted)
                    new = beside(distances, n, i, j, side, 1, new, slanted)
                    if new < old:
                        distances[n, i, j] = new
                        shorter += 1
            again = shorter


@wp.kernel
def _choose(
    stride: int,
    first: int,
    last: int,
    distances: wp.array3d[int],  # (N, h, w)
    weights: wp.array3d[float],
    rects: wp.array2d[int],
    # outputs
    labels: wp.array2d[int],  # (H, W)
):
    width = labels.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        found = int(NOBODY)
        least = int(FAR)
        heaviest = float(0.0)
        for n in range(rects.shape[0]):
            at = inside(rects, n, y, x, width)
            if at[0] >= 0:
                distance = distances[n, at[0], at[1]]
                weight = weights[n, at[0], at[1]]
                if distance >= 0:
                    if distance < least or (least == int(FAR) and weight > heaviest):
                        found = n
                        least = distance
                        heaviest = weight
        labels[y, x] = found
