"""What passes in front of photographs, by a head of NeRF-W on the image plane, in Taichi.

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

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import on_cpu, primitive
from cvkern.kernels.taichi.radiance._fixed_point import add
from cvkern.kernels.taichi.radiance._structs import Comparison, comparison_of
from cvkern.kernels.taichi.radiance.training._comparison import background_of, error_of

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)

Numbers = ti.types.struct(width=ti.i32, side=ti.i32, least=ti.f32, rate=ti.f32, delay=ti.i32)
"""The numbers of a head."""


@ti.func
def _place_of(pixel: ti.i32, width: ti.i32, side: ti.i32):
    """Return the upper left of the nodes around a pixel, and the pixel's offset from it."""
    row, column = pixel // width, pixel % width
    i, j = row // side, column // side
    down = ti.cast(row - i * side, ti.f32) / side
    right = ti.cast(column - j * side, ti.f32) / side
    return i, j, down, right


@ti.func
def _softplus(x: ti.f32) -> ti.f32:
    return ti.max(x, 0.0) + ti.log(1.0 + ti.exp(-ti.abs(x)))


@ti.func
def _logistic(x: ti.f32) -> ti.f32:
    return 1.0 / (1.0 + ti.exp(-x))


@ti.kernel
def _look(
    views: i32_1,  # (R,)
    pixels: i32_1,  # (R,)
    active: i32_1,  # (1,)
    comparison: Comparison,
    learnt: f32_1,  # (3,)
    step: i32_1,  # (1,)
    nodes: f32_4,  # (N, h, w, 5)
    head: Numbers,
    # outputs
    backgrounds: f32_2,  # (R, 3)
    numbers: f32_2,  # (R, 5): interpolated
):
    for ray in range(views.shape[0]):
        if ray < active[0]:
            behind = background_of(comparison, learnt, step[0], ray)
            for k in ti.static(range(3)):
                backgrounds[ray, k] = behind[k]
            view = views[ray]
            i, j, down, right = _place_of(pixels[ray], head.width, head.side)
            for k in ti.static(range(5)):
                upper = nodes[view, i, j, k] * (1.0 - right) + nodes[view, i, j + 1, k] * right
                lower = nodes[view, i + 1, j, k] * (1.0 - right)
                lower += nodes[view, i + 1, j + 1, k] * right
                numbers[ray, k] = upper * (1.0 - down) + lower * down


@ti.kernel
def _loss(
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    targets: f32_2,  # (R, 4)
    active: i32_1,  # (1,)
    comparison: Comparison,
    step: i32_1,  # (1,)
    head: Numbers,
    # outputs
    errors: f32_1,  # (R,)
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_learnt: f32_2,  # (R, 3): before, the backgrounds
    d_head: f32_2,  # (R, 5): before, the numbers
):
    for ray in range(opacity.shape[0]):
        if ray < active[0]:
            behind = ti.Vector([d_learnt[ray, k] for k in range(3)])
            x = ti.Vector([d_head[ray, k] for k in range(5)])
            least = head.least
            learns = step[0] >= head.delay
            left = ti.exp(-_softplus(x[0])) if learns else 1.0
            a = 1.0 - left
            doubt = _softplus(x[4])
            b = least + a * doubt
            seen = targets[ray, 3]
            through = 1.0 - opacity[ray]
            steep = 2.0 / 3.0 * comparison.scale * (least / b) ** 2
            total = 0.0
            d_through = 0.0
            d_a = 0.0
            for k in ti.static(range(3)):
                c = _logistic(x[1 + k])
                f = color[ray, k] + through * behind[k]
                wanted = seen * targets[ray, k] + (1.0 - seen) * behind[k]
                e = error_of(a * c + left * f - wanted, targets[ray, k], seen, comparison)
                total += e * e
                d = steep * e
                d_color[ray, k] = left * d
                d_through += left * d * behind[k]
                d_learnt[ray, k] = d * (left * through - (1.0 - seen))
                d_a += d * (c - f)
                d_head[ray, 1 + k] = d * a * c * (1.0 - c)
            errors[ray] = total / 3.0
            d_opacity[ray] = -d_through
            share = 2.0 / 3.0 * comparison.scale * least**2
            d_b = share * (1.0 / b - total / b**3)
            d_a += d_b * doubt
            d_head[ray, 0] = (d_a * left + share * head.rate) * _logistic(x[0]) if learns else 0.0
            d_head[ray, 4] = d_b * a * _logistic(x[4])
        else:
            errors[ray] = 0.0


@primitive
def loss(
    color: np.ndarray,
    opacity: np.ndarray,
    targets: np.ndarray,
    views: np.ndarray,
    pixels: np.ndarray,
    active: np.ndarray,
    comparison: codes.Comparison,
    head: codes.Head,
    errors: np.ndarray,
    gradients: codes.WildGradients,
) -> None:
    """Compute the squared error of each ray, and the gradients of its loss times a scale.

    As `losses.loss`, for rays through the `pixels` (R,) of the photographs `views` (R,), behind
    what the `head` has there. The errors are those of what is seen, with it.
    """
    c, numbers = comparison_of(comparison), Numbers(*head[1:])
    step, looked = comparison.step, (gradients.learnt, gradients.head)
    # Two kernels, because one would have 20 parameters.
    _look(views, pixels, active, c, comparison.learnt, step, head.nodes, numbers, *looked)
    _loss(color, opacity, targets, active, c, step, numbers, errors, *gradients)


@ti.kernel
def _backward(
    d_head: f32_2,  # (R, 5)
    views: i32_1,  # (R,)
    pixels: i32_1,  # (R,)
    active: i32_1,  # (1,)
    width: ti.i32,
    side: ti.i32,
    threads: ti.i32,
    exact: ti.template(),
    # outputs
    sums: ti.types.ndarray(ndim=4),  # (N, h, w, 5), int64 if exact: added to
):
    for thread in range(threads):
        for n in range((ti.min(active[0], d_head.shape[0]) - thread + threads - 1) // threads):
            ray = thread + n * threads
            i, j, down, right = _place_of(pixels[ray], width, side)
            view = views[ray]
            for k in range(5):
                d = d_head[ray, k]
                if d != 0.0:
                    add(sums[view, i, j, k], (1.0 - down) * (1.0 - right) * d, exact)
                    add(sums[view, i, j + 1, k], (1.0 - down) * right * d, exact)
                    add(sums[view, i + 1, j, k], down * (1.0 - right) * d, exact)
                    add(sums[view, i + 1, j + 1, k], down * right * d, exact)


@primitive
def backward(
    d_head: np.ndarray, views: np.ndarray, pixels: np.ndarray, active: np.ndarray, head: codes.Head,
    sums: np.ndarray,
) -> None:  # fmt: skip
    """Add gradients by the interpolated numbers, `d_head` (R, 5), to those of nodes.

    `sums` (N, h, w, 5) are float32 or, on CUDA, int64 for fixed-point numbers, whose sums do not
    depend on the order. On the CPU, sums are in the order of the rays.
    """
    threads, exact = 1 if on_cpu() else d_head.shape[0], sums.dtype == np.int64
    _backward(d_head, views, pixels, active, head.width, head.side, threads, exact, sums)
