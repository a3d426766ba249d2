"""CIEDE2000 in Warp; the Taichi set has the method, and the same names.

One thread takes a pair of colours; on the CPU, a slab of pairs.
"""

import warp as wp

from cvkern.kernels.codes.color import BLUE, DEGREES
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_DEGREES = wp.constant(wp.float64(DEGREES))
_BLUE = wp.constant(wp.float64(BLUE))


def ciede2000(
    first_colours: wp.array,
    second_colours: wp.array,
    kl: float,
    kc: float,
    kh: float,
    out: wp.array,
) -> None:
    """Work out the differences of pairs of colours in L*a*b*, in float64."""
    inputs = [first_colours, second_colours, kl, kc, kh]
    launch_each(_ciede2000, out.size, 200 * out.size, inputs, [out])


@wp.func
def _seventh(chroma: wp.float64):
    squared = chroma * chroma
    power = squared * squared * squared * chroma
    return power / (power + _BLUE)


@wp.func
def _hue(b: wp.float64, a: wp.float64):
    hue = wp.atan2(b, a) * _DEGREES
    return wp.where(hue < wp.float64(0.0), hue + wp.float64(360.0), hue)


@wp.func
def _cosine(degrees: wp.float64):
    return wp.cos(degrees / _DEGREES)


@wp.func
def _sine(degrees: wp.float64):
    return wp.sin(degrees / _DEGREES)


@wp.kernel
def _ciede2000(
    stride: int,
    first: int,
    last: int,
    first_colours: wp.array2d[float],
    second_colours: wp.array2d[float],
    kl: float,
    kc: float,
    kh: float,
    # outputs
    out: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        l1 = wp.float64(first_colours[i, 0])
        a1 = wp.float64(first_colours[i, 1])
        b1 = wp.float64(first_colours[i, 2])
        l2 = wp.float64(second_colours[i, 0])
        a2 = wp.float64(second_colours[i, 1])
        b2 = wp.float64(second_colours[i, 2])
        mean = (wp.sqrt(a1 * a1 + b1 * b1) + wp.sqrt(a2 * a2 + b2 * b2)) / wp.float64(2.0)
        stretch = wp.float64(1.5) - wp.float64(0.5) * wp.sqrt(_seventh(mean))
        a1 *= stretch
        a2 *= stretch
        c1 = wp.sqrt(a1 * a1 + b1 * b1)
        c2 = wp.sqrt(a2 * a2 + b2 * b2)
        h1 = _hue(b1, a1)
        h2 = _hue(b2, a2)
        turn = h2 - h1
        total = h1 + h2
        grey = c1 * c2 == wp.float64(0.0)
        far = wp.abs(turn) > wp.float64(180.0)
        middle = total / wp.float64(2.0)
        if far:
            middle = middle + wp.where(
                total < wp.float64(360.0), wp.float64(180.0), wp.float64(-180.0)
            )
            turn = turn - wp.where(turn > wp.float64(0.0), wp.float64(360.0), wp.float64(-360.0))
        if grey:
            middle = total
            turn = wp.float64(0.0)
        light = (l1 + l2) / wp.float64(2.0)
        chroma = (c1 + c2) / wp.float64(2.0)
        off = (light - wp.float64(50.0)) * (light - wp.float64(50.0))
        sl = wp.float64(1.0) + wp.float64(0.015) * off / wp.sqrt(wp.float64(20.0) + off)
        sc = wp.float64(1.0) + wp.float64(0.045) * chroma
        t = wp.float64(1.0) - wp.float64(0.17) * _cosine(middle - wp.float64(30.0))
        t += wp.float64(0.24) * _cosine(wp.float64(2.0) * middle)
        t += wp.float64(0.32) * _cosine(wp.float64(3.0) * middle + wp.float64(6.0))
        t -= wp.float64(0.2) * _cosine(wp.float64(4.0) * middle - wp.float64(63.0))
        sh = wp.float64(1.0) + wp.float64(0.015) * chroma * t
        bend = (middle - wp.float64(275.0)) / wp.float64(25.0)
        angle = wp.float64(60.0) * wp.exp(-(bend * bend))
        turned = -wp.float64(2.0) * wp.sqrt(_seventh(chroma)) * _sine(angle)
        dl = (l2 - l1) / (wp.float64(kl) * sl)
        dc = (c2 - c1) / (wp.float64(kc) * sc)
        dh = (
            wp.float64(2.0)
            * wp.sqrt(c1 * c2)
            * _sine(turn / wp.float64(2.0))
            / (wp.float64(kh) * sh)
        )
        squared = dl * dl + dc * dc + dh * dh + turned * dc * dh
        out[i] = wp.float32(wp.sqrt(wp.max(squared, wp.float64(0.0))))
