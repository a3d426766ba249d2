"""Patterns to project: Gray codes and shifted fringes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cvkern._checks import (
    as_items,
    as_numbers,
    check_choice,
    check_flag,
    check_integer,
    check_positive,
    check_sides,
)

AXES = ("columns", "rows")


def gray_code_patterns(
    shape: tuple[int, int], *, axes: Sequence[str] = AXES, lights: bool = False
) -> np.ndarray:
    """Make the patterns of a Gray code, each followed by its inverse.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the projector.
    axes : sequence of {'columns', 'rows'}, default ('columns', 'rows')
        Projector coordinates to encode, in this order.
    lights : bool, default False
        Append a white and a black frame.

    Returns
    -------
    array of shape (K, rows, columns), uint8
        Frames of values 0 and 255. An axis of n lines has 2 ceil(log2(n)) frames: the highest bit
        first, each pattern before its inverse.

    Raises
    ------
    TypeError
        If a side of `shape` is not an integer.
    ValueError
        If a side is not in [1, 65536], or `axes` is empty, repeats an axis or names an unknown one.

    See Also
    --------
    decode_gray_code : Decode photographs of the patterns.

    References
    ----------
    .. [1] S. Inokuchi, K. Sato and F. Matsuda, "Range imaging system for 3-D object recognition",
       ICPR 1984.

    Examples
    --------
    >>> import cvkern
    >>> frames = cvkern.gray_code_patterns((2, 4), axes=["columns"])
    >>> frames[::2, 0] // 255
    array([[0, 0, 1, 1],
           [0, 1, 1, 0]], dtype=uint8)
    """
    lights = check_flag(lights, "lights")
    height, width = check_sides(shape, "shape")
    frames = []
    for axis in check_axes(axes):
        count = width if axis == "columns" else height
        line = np.arange(count)
        code = line ^ (line >> 1)
        for bit in reversed(range(code_bits(count))):
            row = np.where(code >> bit & 1, 255, 0).astype(np.uint8)
            pattern = np.broadcast_to(row if axis == "columns" else row[:, None], (height, width))
            frames += [pattern, 255 - pattern]
    if lights:
        frames += [np.full((height, width), value, np.uint8) for value in (255, 0)]
    return _stacked(frames)


def phase_shift_patterns(
    shape: tuple[int, int],
    frequencies: Sequence[float] = (1, 8, 64),
    steps: int = 4,
    *,
    axes: Sequence[str] = AXES,
    gamma: Any = 1.0,
) -> np.ndarray:
    """Make fringe patterns, each shifted in `steps` equal steps.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the projector.
    frequencies : sequence of float, default (1, 8, 64)
        Periods over the whole axis, ascending. If the first is 1, positions are unambiguous.
    steps : int, default 4
        Shifts of each fringe, at least 3. They cancel harmonics of the projector's gamma up to the
        order ``steps - 2``.
    axes : sequence of {'columns', 'rows'}, default ('columns', 'rows')
        Projector coordinates to encode, in this order.
    gamma : float or array of shape (256,), default 1.0
        What the projector makes of values, which the patterns compensate. Either the exponent: its
        light is the value to this power. Or a table of the light of each value from 0 to 255 in
        any unit, as measured in photographs of plain patterns; it must not fall.

    Returns
    -------
    array of shape (K, rows, columns), uint8
        Frames ordered by axis, then frequency, then step. Step n of N of frequency f has the light
        ``(1 + cos(2 pi (f (x + 1/2) / W - n / N))) / 2`` at column x of W.

    Raises
    ------
    TypeError
        If a number is not one, or a side or `steps` is not an integer.
    ValueError
        If a side is not in [1, 65536], `steps` is not in [3, 64], a frequency or `gamma` is not
        positive, a table of `gamma` has another shape, falls or does not rise at all, frequencies
        do not ascend, or `axes` is empty, repeats an axis or names an unknown one.

    See Also
    --------
    decode_phase_shift : Decode photographs of the patterns.

    References
    ----------
    .. [1] C. Zuo, S. Feng, L. Huang, T. Tao, W. Yin and Q. Chen, "Phase shifting algorithms for
       fringe projection profilometry: a review", Optics and Lasers in Engineering 109, 2018.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.phase_shift_patterns((1, 4), [1], 4, axes=["columns"])[:, 0]
    array([[218,  37,  37, 218],
           [218, 218,  37,  37],
           [ 37, 218, 218,  37],
           [ 37,  37, 218, 218]], dtype=uint8)
    """
    height, width = check_sides(shape, "shape")
    steps = check_integer(steps, "steps", 3, 64)
    levels = _levels_of(gamma)
    frames = []
    for axis in check_axes(axes):
        count = width if axis == "columns" else height
        turns = (np.arange(count) + 0.5) / count
        for frequency in check_frequencies(frequencies):
            for n in range(steps):
                light = (1 + np.cos(2 * math.pi * (frequency * turns - n / steps))) / 2
                row = levels(light)
                whole = row if axis == "columns" else row[:, None]
                frames.append(np.broadcast_to(whole, (height, width)))
    return _stacked(frames)


def _stacked(frames: list[np.ndarray]) -> np.ndarray:
    """Return frames as one array, each row by row: the stack of broadcast ones may be otherwise."""
    return np.stack(frames, out=np.empty((len(frames), *frames[0].shape), np.uint8))


def _levels_of(gamma: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function from light, in [0, 1], to values of the projector, uint8."""
    if np.ndim(gamma) == 0:
        power = 1 / check_positive(gamma, "gamma")
        return lambda light: np.round(255 * light**power).astype(np.uint8)
    table = as_numbers(gamma, "gamma")
    if table.shape != (256,):
        raise ValueError(f"gamma must be a number or have shape (256,), got {table.shape}")
    if not (np.isfinite(table).all() and (np.diff(table) >= 0).all() and table[-1] > table[0]):
        raise ValueError("gamma must be finite and rise, got a table that does not")
    lights = (table - table[0]) / (table[-1] - table[0])
    # The value whose light is nearest.
    middles = (lights[1:] + lights[:-1]) / 2
    return lambda light: np.searchsorted(middles, light).astype(np.uint8)


def code_bits(count: int) -> int:
    """Return the number of bits that distinguish `count` lines."""
    return max(1, (count - 1).bit_length())


def check_axes(axes: Any) -> tuple[str, ...]:
    """Return `axes` as a tuple of one or both names, none twice."""
    axes = (axes,) if isinstance(axes, str) else as_items(axes, "axes", f"of {AXES}")
    for axis in axes:
        check_choice(axis, AXES, "axes")
    if len(set(axes)) != len(axes) or not axes:
        raise ValueError(f"axes must name one axis or both, each once, got {axes}")
    return axes


def check_frequencies(frequencies: Any) -> tuple[float, ...]:
    """Return the frequencies as positive numbers in ascending order."""
    if np.ndim(frequencies) != 1 or not len(frequencies):
        raise ValueError(f"frequencies must be a sequence of numbers, got {frequencies!r}")
    found = tuple(check_positive(f, "frequencies") for f in frequencies)
    if any(b <= a for a, b in pairwise(found)):
        raise ValueError(f"frequencies must rise, got {found}")
    return found
