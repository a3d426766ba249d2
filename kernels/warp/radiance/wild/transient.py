"""What passes in front of photographs, by a head of NeRF-W on the image plane, in Warp.

A photograph has nodes every `side` pixels, with numbers (s, r, u): a density log(1 + e^s), a colour
1 / (1 + e^-r), and a doubt log(1 + e^u). They are interpolated in between as these numbers.
Composited in front of the scene's colour F, over its background, with a = 1 - exp(-density),

    C = a c + (1 - a) F,    b = least + a doubt,

and the loss is S (|C - P|^2 / (2 b^2) + log b + rate density), with the factor S = 2/3 least^2, so
that it is the mean squared error of the channels where a = 0 [Martin-Brualla et al., "NeRF in the
wild", 2021]. With D = 2/3 (least / b)^2 (C - P) and E = S (1 / b - |C - P|^2 / b^3),

    dL/dF = (1 - a) D,    dL/da = <D, c - F> + E doubt,    dL/dc = a D,    dL/d doubt = a E.

One thread takes a ray. Gradients of the numbers are added to the four nodes around its pixel.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch, launch_each
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._fixed_point import LIMIT, UNIT
from cvkern.kernels.warp.radiance._structs import Comparison, Head, WildGradients
from cvkern.kernels.warp.radiance.training.losses import background_of, error_of

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)

LOST = wp.constant(wp.int64(-3 * 2**61))  # a sum with a NaN, which no summands bring back
vec5 = wp.types.vector(5, wp.float32)


@wp.struct
class Aims:
    """Where a batch of rays goes through photographs."""

    views: wp.array[int]  # (R,)
    pixels: wp.array[int]  # (R,)
    active: wp.array[int]  # (1,)


@wp.struct
class Place:
    """The upper left of the four nodes around a pixel, and the pixel's offset from it."""

    row: int
    column: int
    down: float
    right: float


@wp.func
def place_of(pixel: int, width: int, side: int) -> Place:
    """Return the nodes around a pixel."""
    place = Place()
    row = pixel // width
    column = pixel - row * width
    place.row = row // side
    place.column = column // side
    place.down = float(row - place.row * side) / float(side)
    place.right = float(column - place.column * side) / float(side)
    return place


@wp.func
def softplus(x: float) -> float:
    """Return log(1 + e^x)."""
    return wp.max(x, 0.0) + wp.log(1.0 + wp.exp(-wp.abs(x)))


@wp.func
def logistic(x: float) -> float:
    """Return 1 / (1 + e^-x)."""
    return 1.0 / (1.0 + wp.exp(-x))


@wp.kernel
def loss_kernel(
    stride: int,
    first: int,
    last: int,
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    targets: wp.array2d[float],  # (R, 4)
    aims: Aims,
    comparison: Comparison,
    head: Head,
    # outputs
    errors: wp.array[float],  # (R,)
    gradients: WildGradients,
):
    """Compare a ray, behind what passes, with its target."""
    least = head.least
    for ray in range(first + wp.tid(), last, stride):
        if ray < aims.active[0]:
            behind = background_of(comparison, ray)
            view = aims.views[ray]
            at = place_of(aims.pixels[ray], head.width, head.side)
            x = vec5()
            for k in range(5):
                upper = head.nodes[view, at.row, at.column, k] * (1.0 - at.right)
                upper += head.nodes[view, at.row, at.column + 1, k] * at.right
                lower = head.nodes[view, at.row + 1, at.column, k] * (1.0 - at.right)
                lower += head.nodes[view, at.row + 1, at.column + 1, k] * at.right
                x[k] = upper * (1.0 - at.down) + lower * at.down
            learns = comparison.step[0] >= head.delay
            density = softplus(x[0])
            left = wp.exp(-density)
            if not learns:
                left = float(1.0)
            a = 1.0 - left
            doubt = softplus(x[4])
            b = least + a * doubt
            seen = targets[ray, 3]
            through = 1.0 - opacity[ray]
            steep = 2.0 / 3.0 * comparison.scale * (least / b) * (least / b)
            total = float(0.0)
            d_through = float(0.0)
            d_a = float(0.0)
            for k in range(3):
                c = logistic(x[1 + k])
                f = color[ray, k] + through * behind[k]
                found = a * c + left * f
                wanted = seen * targets[ray, k] + (1.0 - seen) * behind[k]
                e = error_of(found - wanted, targets[ray, k], seen, comparison)
                total += e * e
                d = steep * e
                gradients.color[ray, k] = left * d
                d_through += left * d * behind[k]
                gradients.learnt[ray, k] = d * (left * through - (1.0 - seen))
                d_a += d * (c - f)
                gradients.head[ray, 1 + k] = d * a * c * (1.0 - c)
            errors[ray] = total / 3.0
            gradients.opacity[ray] = -d_through
            share = 2.0 / 3.0 * comparison.scale * least * least
            d_b = share * (1.0 / b - total / (b * b * b))
            d_a += d_b * doubt
            gradients.head[ray, 0] = (d_a * left + share * head.rate) * logistic(x[0])
            gradients.head[ray, 4] = d_b * a * logistic(x[4])
            if not learns:
                gradients.head[ray, 0] = 0.0
        else:
            errors[ray] = 0.0


def loss(
    color: wp.array,
    opacity: wp.array,
    targets: wp.array,
    views: wp.array,
    pixels: wp.array,
    active: wp.array,
    comparison: codes.Comparison,
    head: codes.Head,
    errors: wp.array,
    gradients: codes.WildGradients,
) -> None:
    """Compute the squared error of each ray, and the gradients of its loss times a scale.

    As `losses.loss`, for rays through the `pixels` (R,) of the photographs `views` (R,), behind
    what the `head` has there. The errors are those of what is seen, with it.
    """
    count = opacity.shape[0]
    inputs = [
        color, opacity, targets, struct_of(Aims, (views, pixels, active)),
        struct_of(Comparison, comparison), struct_of(Head, head),
    ]  # fmt: skip
    outputs = [errors, struct_of(WildGradients, gradients)]
    launch_each(loss_kernel, count, 128 * count, inputs, outputs)


@cache
def scatterer(total: Any, serial: bool) -> wp.Kernel:
    """Return the kernel that adds gradients to nodes."""
    exact = total is wp.int64

    @wp.func
    def add(sums: wp.array4d[total], view: int, row: int, column: int, k: int, value: float):
        if wp.static(exact):
            if value != value:
                wp.atomic_min(sums, view, row, column, k, LOST)
            else:
                fixed = wp.int64(wp.rint(wp.clamp(value, -LIMIT, LIMIT) / UNIT))
                wp.atomic_add(sums, view, row, column, k, fixed)
        elif wp.static(serial):
            sums[view, row, column, k] = sums[view, row, column, k] + value
        else:
            wp.atomic_add(sums, view, row, column, k, value)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def scatter(
        stride: int,
        first: int,
        last: int,
        d_head: wp.array2d[float],  # (R, 5)
        views: wp.array[int],  # (R,)
        pixels: wp.array[int],  # (R,)
        active: wp.array[int],  # (1,)
        width: int,
        side: int,
        # outputs
        sums: wp.array4d[total],  # (N, h, w, 5): added to
    ):
        for ray in range(first + wp.tid(), last, stride):
            if ray < active[0]:
                at = place_of(pixels[ray], width, side)
                view = views[ray]
                for k in range(5):
                    d = d_head[ray, k]
                    if d != 0.0:
                        upper = (1.0 - at.down) * d
                        lower = at.down * d
                        i = at.row
                        j = at.column
                        add(sums, view, i, j, k, upper * (1.0 - at.right))
                        add(sums, view, i, j + 1, k, upper * at.right)
                        add(sums, view, i + 1, j, k, lower * (1.0 - at.right))
                        add(sums, view, i + 1, j + 1, k, lower * at.right)

    return scatter


def backward(
    d_head: wp.array, views: wp.array, pixels: wp.array, active: wp.array, head: codes.Head,
    sums: wp.array,
) -> None:  # fmt: skip
    """Add gradients by the interpolated numbers, `d_head` (R, 5), to those of nodes.

    `sums` (N, h, w, 5) are float32 or, on CUDA, int64 for fixed-point numbers, whose sums do not
    depend on the order. On the CPU, sums are in the order of the rays.
    """
    count = d_head.shape[0]
    inputs = [d_head, views, pixels, active, head.width, head.side]
    if sums.device.is_cuda:
        launch_each(scatterer(sums.dtype, False), count, count, inputs, [sums])
    else:
        launch(scatterer(sums.dtype, True), 1, [1, 0, count, *inputs], [sums])
