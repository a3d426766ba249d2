"""Decoding of photographs of shifted fringes to phases and projector coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_integer, check_number, check_sides
from cvkern._notices import may_look, warn
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.kernels.codes.structured_light import Decoded, Fringes
from cvkern.structured_light._frames import (
    carried_as,
    grid_step,
    share_of_brightest,
    stacked,
)
from cvkern.structured_light.patterns import AXES, check_axes, check_frequencies

SHARE = 0.05  # least modulation of a valid pixel, as a share of the largest one
BRIGHTEST = 0.99  # quantile of the modulations


class PhaseShift(NamedTuple):
    """Projector coordinates and phases at each pixel of a camera."""

    columns: Any
    """Sub-pixel column of the projector, (H, W) float32; None if not requested."""
    rows: Any
    """Sub-pixel row of the projector, (H, W) float32; None if not requested."""
    valid: Any
    """Whether the modulation of all axes is above the threshold, (H, W) bool."""
    phase: Any
    """Phase of the highest frequency of each axis, (axes, H, W) float32, in (-pi, pi]."""
    modulation: Any
    """Least fringe amplitude of each axis, (axes, H, W) float32, in values of the images."""


def decode_phase_shift(
    images: Any,
    shape: tuple[int, int],
    frequencies: Sequence[float] = (1, 8, 64),
    steps: int = 4,
    *,
    axes: Sequence[str] = AXES,
    threshold: float | None = None,
) -> PhaseShift:
    """Decode photographs of shifted fringes.

    Parameters
    ----------
    images : array of shape (K, H, W)
        Photographs of `phase_shift_patterns` with the same arguments, in its order. Any real dtype.
        A sequence of K NumPy images also works.
    shape : (int, int)
        Rows and columns of the projector.
    frequencies : sequence of float, default (1, 8, 64)
        Periods over the whole axis, ascending. Each frequency gets its fringe number from the one
        before. If the first is above 1, positions are known within its first period only: with a
        single frequency, pass `phase` to `unwrap_phase`.
    steps : int, default 4
        Shifts of each fringe, at least 3.
    axes : sequence of {'columns', 'rows'}, default ('columns', 'rows')
        Projector coordinates that the images encode, in their order.
    threshold : float, optional
        A pixel is valid if the modulation of every frequency is above this. By default 5 % of the
        99 % quantile of the modulations, on a grid of pixels.

    Returns
    -------
    PhaseShift
        Named tuple of `columns` and `rows` (H, W) float32, `valid` (H, W) bool, `phase` and
        `modulation` (axes, H, W) float32, equal bit for bit on all devices. A pixel with a value
        that is not finite gives NaN and is not valid.

    Raises
    ------
    TypeError
        If `images` does not hold real numbers, or a number is not one.
    ValueError
        If the number of images does not match the other arguments, shapes differ, or a number is
        out of range.

    See Also
    --------
    phase_shift_patterns : The patterns.

    Notes
    -----
    For noise of standard deviation s, modulation B and N steps, the standard deviation of a phase
    is ``s sqrt(2 / N) / B``, which is the Cramer-Rao bound.

    References
    ----------
    .. [1] C. Zuo, L. Huang, M. Zhang, Q. Chen and A. Asundi, "Temporal phase unwrapping algorithms
       for fringe projection profilometry: a comparative review", Optics and Lasers in
       Engineering 85, 2016.

    Examples
    --------
    >>> import cvkern
    >>> seen = cvkern.phase_shift_patterns((2, 5), [1, 2])  # a camera in the projector's place
    >>> cvkern.decode_phase_shift(seen, (2, 5), [1, 2]).columns[0, 1:].round(1)
    array([1., 2., 3., 4.], dtype=float32)
    """
    height, width = check_sides(shape, "shape")
    axes, frequencies = check_axes(axes), check_frequencies(frequencies)
    steps = check_integer(steps, "steps", 3, 64)
    images = stacked(images)
    each = steps * len(frequencies)
    if images.shape[0] != each * len(axes):
        raise ValueError(
            f"images must be {each * len(axes)} for {len(frequencies)} frequencies of {steps} "
            f"steps and {' and '.join(axes)}, got {images.shape[0]}"
        )
    if threshold is not None:
        threshold = check_number(threshold, "threshold", low=0)
    seen = tuple(images.shape[1:])
    rt = runtime(images)
    dtype = library(images).dtype(images)
    frames = rt.adopt(images, carried_as(dtype))
    turns = 2 * math.pi * np.arange(steps) / steps
    # Rounded, so that sines of quarter turns are whole numbers.
    waves = np.stack([np.sin(turns), np.cos(turns)], axis=1).round(12).astype(np.float32)
    waves = rt.constant(waves + np.float32(0))  # no -0
    numbers = rt.constant(np.array(frequencies, np.float32))

    places, valid = [rt.empty(seen) for _ in axes], rt.empty(seen, bool)
    good, least = rt.adopt(valid, bool), 0.0 if threshold is None else threshold
    phase, modulation = (rt.empty((len(axes), *seen)) for _ in range(2))
    planes = [
        [rt.adopt(a, np.float32, (len(axes), *seen))[n] for n in range(len(axes))]
        for a in (phase, modulation)
    ]
    for n, axis in enumerate(axes):
        size = width if axis == "columns" else height
        rt.structured_light.phase.decode(
            frames, n * each, Fringes(numbers, waves, size, least, n > 0),
            Decoded(rt.adopt(places[n]), planes[0][n], planes[1][n], good),
        )  # fmt: skip
    if threshold is None:  # the default depends on the modulations
        strengths = planes[1][0], planes[1][-1]
        rt.structured_light.phase.accept(*strengths, _threshold(rt, planes[1]), good)
    elif least > 0 and may_look(rt):
        most = min(np.fmax.reduce(rt.to_numpy(a), axis=None, initial=0.0) for a in planes[1])
        if 0 < most < least:
            warn(
                f"no phase was found: the largest modulation is {most:.4g}, below threshold "
                f"{least:.4g}"
            )
    found = {axis: rt.release(place) for axis, place in zip(axes, places, strict=True)}
    return PhaseShift(
        found.get("columns"), found.get("rows"),
        *(rt.release(a) for a in (valid, phase, modulation)),
    )  # fmt: skip


def _threshold(rt: Runtime, modulations: list[Any]) -> float:
    """Return a share of the largest modulations, for the axis where it is smaller."""
    refuse_capture("decode_phase_shift without a threshold")
    height, width = modulations[0].shape
    step = grid_step(height, width)
    shape = (len(modulations), -(-height // step), -(-width // step))
    some = rt.scratch("phase.samples", shape)
    for n, plane in enumerate(modulations):
        rt.transform.pyramids.thin(plane, step, some[n])
    return min(share_of_brightest(part, BRIGHTEST, SHARE) for part in rt.to_numpy(some))
