"""What splats do in training beside Adam's steps, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._random import random_bits
from cvkern.kernels.warp._structs import struct_of

from ._placing import exponential, turn_of
from ._structs import Splats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

X, Y, Z = (wp.constant(int(d)) for d in (codes.Draw.X, codes.Draw.Y, codes.Draw.Z))
HALF = wp.constant(wp.uint32(0xFFFF))
SPREAD = wp.constant(3.0**0.5 / 65536.0)  # makes the variance of four uniform numbers 1


@wp.kernel
def restrain_kernel(
    stride: int,
    first: int,
    last: int,
    splats: Splats,
    opacity: float,
    size: float,
    # outputs
    d_splats: Splats,
):
    """Add the gradients of the costs of opacities and sizes."""
    for n in range(first + wp.tid(), last, stride):
        o = 1.0 / (1.0 + exponential(-splats.opacities[n, 0]))
        d_splats.opacities[n, 0] = d_splats.opacities[n, 0] + opacity * (o * (1.0 - o))
        for k in range(3):
            d_splats.scales[n, k] = d_splats.scales[n, k] + size * exponential(splats.scales[n, k])


def restrain(splats: codes.Splats, opacity: float, size: float, d_splats: codes.Splats) -> None:
    """Add the gradients of `opacity` times the sum of opacities, and `size` times that of sizes."""
    count = splats.means.shape[0]
    inputs = [struct_of(Splats, splats), opacity, size]
    launch_each(restrain_kernel, count, 16 * count, inputs, [struct_of(Splats, d_splats)])


@wp.func
def normal(seed: int, step: int, n: int, which: int) -> float:
    """Return a number of mean 0 and variance 1, nearly normal."""
    a = random_bits(seed, step, n, which)
    b = random_bits(seed, step, n, which + 1)
    total = (a & HALF) + (a >> wp.uint32(16)) + (b & HALF) + (b >> wp.uint32(16))
    return (float(int(total)) - 131070.0) * SPREAD


@wp.kernel
def wander_kernel(
    stride: int,
    first: int,
    last: int,
    rate: wp.array[float],  # (3,)
    strength: float,
    seed: int,
    step: wp.array[int],  # (1,)
    # outputs
    splats: Splats,
):
    """Move a splat by its random way."""
    for n in range(first + wp.tid(), last, stride):
        o = 1.0 / (1.0 + exponential(-splats.opacities[n, 0]))
        share = strength * rate[0] / (1.0 + exponential(100.0 * (o - 0.005)))
        w = splats.turns[n, 0]
        x = splats.turns[n, 1]
        y = splats.turns[n, 2]
        z = splats.turns[n, 3]
        length = wp.sqrt(w * w + x * x + y * y + z * z)
        if length > 1e-12:
            turn = turn_of(w / length, x / length, y / length, z / length)
            a = normal(seed, step[0], n, X)
            b = normal(seed, step[0], n, Y)
            c = normal(seed, step[0], n, Z)
            for m in range(3):
                size = exponential(splats.scales[n, m])
                along = turn[0, m] * a + turn[1, m] * b + turn[2, m] * c
                way = share * (size * size * along)
                for j in range(3):
                    splats.means[n, j] = splats.means[n, j] + turn[j, m] * way


def wander(
    rate: wp.array, strength: float, seed: int, step: wp.array, splats: codes.Splats
) -> None:
    """Move faint splats at random; larger ones move farther."""
    count = splats.means.shape[0]
    inputs = [rate, strength, seed, step]
    launch_each(wander_kernel, count, 32 * count, inputs, [struct_of(Splats, splats)])


@wp.func
def move_row(
    values: wp.array2d[float], mean: wp.array2d[float], square: wp.array2d[float], to: int, at: int
):
    """Copy a row, and forget the moments."""
    for k in range(values.shape[1]):
        values[to, k] = values[at, k]
        mean[to, k] = 0.0
        square[to, k] = 0.0


@wp.kernel
def relocate_kernel(
    stride: int,
    first: int,
    last: int,
    rows: wp.array2d[int],  # (M, 2)
    numbers: wp.array2d[float],  # (M, 2)
    # outputs
    splats: Splats,
    mean: Splats,
    square: Splats,
):
    """Copy a splat."""
    for m in range(first + wp.tid(), last, stride):
        to = rows[m, 0]
        at = rows[m, 1]
        move_row(splats.means, mean.means, square.means, to, at)
        move_row(splats.turns, mean.turns, square.turns, to, at)
        move_row(splats.scales, mean.scales, square.scales, to, at)
        move_row(splats.opacities, mean.opacities, square.opacities, to, at)
        move_row(splats.colors, mean.colors, square.colors, to, at)
        if splats.sides.shape[1] > 1:
            move_row(splats.sides, mean.sides, square.sides, to, at)
        splats.opacities[to, 0] = numbers[m, 0]
        for k in range(3):
            splats.scales[to, k] = splats.scales[to, k] + numbers[m, 1]


def relocate(
    rows: wp.array,
    numbers: wp.array,
    splats: codes.Splats,
    mean: codes.Splats,
    square: codes.Splats,
) -> None:
    """Make M splats copies of others, and forget Adam's moments of them.

    `rows` (M, 2) int32 has the splats that change, each once, and the splats that they copy. A
    splat that copies itself changes too; the other sources do not change. `numbers` (M, 2) are
    their opacities, before the logistic function, and the changes of the logarithms of their sizes.
    """
    count = rows.shape[0]
    outputs = [struct_of(Splats, s) for s in (splats, mean, square)]
    launch_each(relocate_kernel, count, 256 * count, [rows, numbers], outputs)
