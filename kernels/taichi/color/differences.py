"""CIEDE2000 in Taichi [Sharma, Wu and Dalal 2005].

Chroma is stretched where it is small, lightness, chroma and hue are weighted by how well the eye
tells them there, and blue has a term that turns chroma into hue. In float64.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import BLUE, DEGREES
from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.func
def _seventh(chroma: ti.f64) -> ti.f64:
    squared = chroma * chroma
    power = squared * squared * squared * chroma
    return power / (power + ti.f64(BLUE))


@ti.func
def _hue(b: ti.f64, a: ti.f64) -> ti.f64:
    hue = ti.atan2(b, a) * ti.f64(DEGREES)
    return hue + ti.f64(360.0) if hue < ti.f64(0.0) else hue


@ti.func
def _cosine(degrees: ti.f64) -> ti.f64:
    return ti.cos(degrees / ti.f64(DEGREES))


@ti.func
def _sine(degrees: ti.f64) -> ti.f64:
    return ti.sin(degrees / ti.f64(DEGREES))


@ti.kernel
def _ciede2000(
    first_colours: f32_2, second_colours: f32_2, kl: ti.f32, kc: ti.f32, kh: ti.f32, out: f32_1
):
    for i in range(out.shape[0]):
        l1 = ti.cast(first_colours[i, 0], ti.f64)
        a1 = ti.cast(first_colours[i, 1], ti.f64)
        b1 = ti.cast(first_colours[i, 2], ti.f64)
        l2 = ti.cast(second_colours[i, 0], ti.f64)
        a2 = ti.cast(second_colours[i, 1], ti.f64)
        b2 = ti.cast(second_colours[i, 2], ti.f64)
        mean = ((ti.sqrt(a1 * a1 + b1 * b1)) + (ti.sqrt(a2 * a2 + b2 * b2))) / ti.f64(2.0)
        stretch = ti.f64(1.5) - ti.f64(0.5) * ti.sqrt(_seventh(mean))
        a1 *= stretch
        a2 *= stretch
        c1 = ti.sqrt(a1 * a1 + b1 * b1)
        c2 = ti.sqrt(a2 * a2 + b2 * b2)
        h1 = _hue(b1, a1)
        h2 = _hue(b2, a2)
        turn = h2 - h1
        total = h1 + h2
        grey = c1 * c2 == ti.f64(0.0)
        far = ti.abs(turn) > ti.f64(180.0)
        middle = total / ti.f64(2.0)
        if far:
            middle = middle + (ti.f64(180.0) if total < ti.f64(360.0) else ti.f64(-180.0))
            turn = turn - (ti.f64(360.0) if turn > ti.f64(0.0) else ti.f64(-360.0))
        if grey:
            middle = total
            turn = ti.f64(0.0)
        light = (l1 + l2) / ti.f64(2.0)
        chroma = (c1 + c2) / ti.f64(2.0)
        off = (light - ti.f64(50.0)) * (light - ti.f64(50.0))
        sl = ti.f64(1.0) + ti.f64(0.015) * off / ti.sqrt(ti.f64(20.0) + off)
        sc = ti.f64(1.0) + ti.f64(0.045) * chroma
        t = ti.f64(1.0) - ti.f64(0.17) * _cosine(middle - ti.f64(30.0))
        t += ti.f64(0.24) * _cosine(ti.f64(2.0) * middle)
        t += ti.f64(0.32) * _cosine(ti.f64(3.0) * middle + ti.f64(6.0))
        t -= ti.f64(0.2) * _cosine(ti.f64(4.0) * middle - ti.f64(63.0))
        sh = ti.f64(1.0) + ti.f64(0.015) * chroma * t
        bend = (middle - ti.f64(275.0)) / ti.f64(25.0)
        angle = ti.f64(60.0) * ti.exp(-(bend * bend))
        turned = -ti.f64(2.0) * ti.sqrt(_seventh(chroma)) * _sine(angle)
        dl = (l2 - l1) / (ti.cast(kl, ti.f64) * sl)
        dc = (c2 - c1) / (ti.cast(kc, ti.f64) * sc)
        dh = ti.f64(2.0) * ti.sqrt(c1 * c2) * _sine(turn / ti.f64(2.0)) / (ti.cast(kh, ti.f64) * sh)
        squared = dl * dl + dc * dc + dh * dh + turned * dc * dh
        out[i] = ti.cast(ti.sqrt(ti.max(squared, ti.f64(0.0))), ti.f32)


@primitive
def ciede2000(
    first_colours: np.ndarray,
    second_colours: np.ndarray,
    kl: float,
    kc: float,
    kh: float,
    out: np.ndarray,
) -> None:
    """Work out the differences of pairs of colours in L*a*b*, in float64; one thread a pair."""
    _ciede2000(first_colours, second_colours, kl, kc, kh, out)
