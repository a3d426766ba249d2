"""Decoding of Gray-code photographs to projector coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_image, check_number, check_sides
from cvkern._notices import may_look, warn
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.structured_light._frames import carried_as, grid_step, stacked
from cvkern.structured_light.patterns import AXES, check_axes, code_bits

MARGIN = 2.5  # least difference of a pair, in standard deviations of the noise
ROUNDING = 12**-0.5  # standard deviation of rounding to integers


class GrayCode(NamedTuple):
    """Projector coordinates at each pixel of a camera."""

    columns: Any
    """Column of the projector, (H, W) int32; -1 where unknown, None if not requested."""
    rows: Any
    """Row of the projector, (H, W) int32; -1 where unknown, None if not requested."""
    valid: Any
    """Whether all requested coordinates are known, (H, W) bool."""


def decode_gray_code(
    images: Any,
    shape: tuple[int, int],
    white: Any = None,
    black: Any = None,
    *,
    axes: Sequence[str] = AXES,
    margin: float | None = None,
    contrast: float | None = None,
) -> GrayCode:
    """Decode photographs of Gray-code patterns and their inverses.

    Parameters
    ----------
    images : array of shape (K, H, W)
        Photographs of `gray_code_patterns` in its order: for each of `axes` the highest bit first,
        each pattern before its inverse. Any real dtype. A sequence of K NumPy images also works.
    shape : (int, int)
        Rows and columns of the projector.
    white, black : array of shape (H, W), optional
        Photographs of an all-white and an all-black frame. Give both or neither.
    axes : sequence of {'columns', 'rows'}, default ('columns', 'rows')
        Projector coordinates that the images encode, in their order.
    margin : float, optional
        A pattern and its inverse must differ by more than this, in values of the images. By default
        2.5 standard deviations of the noise. The noise is estimated from the images: the sum of a
        pattern and its inverse is the same light for every bit.
    contrast : float, optional
        White must be brighter than black by more than this; by default twice `margin`. Only with
        `white` and `black`.

    Returns
    -------
    GrayCode
        Named tuple of `columns` and `rows`, (H, W) int32, and `valid`, (H, W) bool. Coordinates are
        -1 where a pixel saw no code or a code beyond `shape`. The result is equal bit for bit on
        all devices.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If the number of images does not match `shape` and `axes`, shapes differ, arrays are on
        several devices, one of `white` and `black` is missing, `contrast` is given without them, or
        a number is out of range.

    See Also
    --------
    gray_code_patterns : The patterns.

    References
    ----------
    .. [1] S. Inokuchi, K. Sato and F. Matsuda, "Range imaging system for 3-D object recognition",
       ICPR 1984.

    Examples
    --------
    >>> import cvkern
    >>> seen = cvkern.gray_code_patterns((3, 5))  # a camera in the place of the projector
    >>> cvkern.decode_gray_code(seen, (3, 5)).columns[0]
    array([0, 1, 2, 3, 4], dtype=int32)
    """
    height, width = check_sides(shape, "shape")
    axes = check_axes(axes)
    images = stacked(images)
    counts = [2 * code_bits(width if axis == "columns" else height) for axis in axes]
    if images.shape[0] != sum(counts):
        raise ValueError(
            f"images must be {sum(counts)} for {' and '.join(axes)} of shape {(height, width)}, "
            f"got {images.shape[0]}"
        )
    seen = tuple(images.shape[1:])
    if contrast is not None:
        contrast = check_number(contrast, "contrast", low=0)
    if white is None and black is None and contrast is not None:
        raise ValueError(f"contrast must be None without white and black, got {contrast}")
    if (white is None) != (black is None):
        raise ValueError("white and black must be given together, got one of them")
    lights = [] if white is None else [check_image(a, name=n) for a, n in
                                       ((white, "white"), (black, "black"))]  # fmt: skip
    for light, name in zip(lights, ("white", "black"), strict=False):
        if tuple(light.shape) != seen:
            raise ValueError(f"{name} must have the shape of an image, {seen}, got {light.shape}")
    rt = runtime(images, *lights)
    dtype = library(images).dtype(images)
    frames = rt.adopt(images, carried_as(dtype))
    told = margin is not None
    if margin is None:
        margin = MARGIN * _noise(rt, frames, counts, integral=dtype.kind in "biu")
    margin = check_number(margin, "margin", low=0)
    contrast = 2 * margin if contrast is None else contrast

    found, begin, valid = {}, 0, rt.empty(seen, bool)
    good = rt.adopt(valid, bool)
    for axis, count in zip(axes, counts, strict=True):
        found[axis] = rt.empty(seen, np.int32)
        size = width if axis == "columns" else height
        codes = rt.adopt(found[axis], np.int32)
        rt.structured_light.gray_code.decode(
            frames, begin, count // 2, size, margin, begin > 0, codes, good
        )
        begin += count
    if lights:
        kinds = {carried_as(library(light).dtype(light)) for light in lights}
        kind = kinds.pop() if len(kinds) == 1 else np.float32
        bright, dark = (rt.adopt(light, kind) for light in lights)
        rt.structured_light.gray_code.accept(bright, dark, contrast, good)
    if told and margin > 0 and may_look(rt):
        _warn_of_none(rt.to_numpy(frames), rt.to_numpy(good), margin)
    released = {axis: rt.release(codes) for axis, codes in found.items()}
    return GrayCode(released.get("columns"), released.get("rows"), rt.release(valid))


def _warn_of_none(frames: np.ndarray, good: np.ndarray, margin: float) -> None:
    """Warn if no pattern differs from its inverse by the margin."""
    if good.any():
        return
    apart = np.abs(frames[::2].astype(np.float64) - frames[1::2])
    most = float(np.fmax.reduce(apart, axis=None, initial=0.0))
    if 0 < most <= margin:
        warn(
            f"no code was found: a pattern and its inverse differ by at most {most:.4g}, and "
            f"margin is {margin:.4g}"
        )


def _noise(rt: Runtime, frames: Any, counts: list[int], *, integral: bool) -> float:
    """Estimate the standard deviation of the noise of a frame from sums of pairs.

    All sums of a pattern and its inverse should be equal. The difference of two sums has twice the
    standard deviation of a frame. The estimate uses the smaller half of the absolute differences,
    which edges and interreflections do not reach. For normal noise its mean square is 0.1426 of the
    variance.
    """
    refuse_capture("decode_gray_code without a margin")
    height, width = frames.shape[1:]
    step = grid_step(height, width)
    samples = -(-height // step) * -(-width // step)
    found, begin = [], 0
    for count in counts:
        pairs = count // 2
        if pairs > 1:
            spreads = rt.scratch("gray_code.spreads", (samples, pairs - 1))
            rt.structured_light.gray_code.spreads(frames, begin, step, spreads)
            found.append(rt.to_numpy(spreads).ravel().astype(np.float64))
        begin += count
    low = ROUNDING if integral else 0.0
    if not found:
        return low
    differences = np.sort(np.concatenate(found))  # NaN last
    half = differences[: -(-len(differences) // 2)]
    sigma = math.sqrt(float(np.mean(half**2)) / 0.1426) / 2
    return max(low, sigma) if math.isfinite(sigma) else low
