"""Compositing of samples along rays, for your own field, and its gradients."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import device, library
from cvkern._checks import as_array, check_beside, check_flag, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.radiance import Composited

__all__ = ["Composite", "CompositeGradient", "composite_rays", "composite_rays_backward"]

STOP = 1e-4
MOST_RAYS = 2**26 - 1  # on a GPU, a ray has 32 threads, and thread numbers have 31 bits


class Composite(NamedTuple):
    """The results of compositing rays, without a background; or gradients of a loss by them."""

    color: Any
    """Weighted sum of the samples' colours, (R, 3) float32."""
    opacity: Any
    """Sum of the weights, from 0 to 1, (R,) float32."""
    depth: Any
    """Weighted sum of the samples' distances, (R,) float32."""
    distortion: Any
    """Spread of the weights along the ray, (R,) float32; see :func:`composite_rays`."""


class CompositeGradient(NamedTuple):
    """Gradients of a loss by the samples, 0 for samples of no ray."""

    density: Any
    """(M,) float32."""
    color: Any
    """(M, 3) float32."""


def composite_rays(
    density: Any, color: Any, distances: Any, spans: Any, *, stop: float = STOP, check: bool = True
) -> Composite:
    """Composite the samples of each ray, front to back.

    Sample i of a ray, with density s_i, colour c_i, distance t_i and length d_i, has the weight
    ``w_i = T_i (1 - exp(-s_i d_i))``. Here ``T_i = exp(-sum_{j < i} s_j d_j)`` is the share of
    light that reaches the sample.

    Parameters
    ----------
    density : array of shape (M,)
        Density of the samples of all rays, >= 0, per unit of length.
    color : array of shape (M, 3)
        Colour of the samples, in any linear unit.
    distances : array of shape (M, 2)
        Distance of each sample from the camera, which must not decrease along a ray, and the
        length >= 0 of the part of the ray that the sample stands for.
    spans : array of shape (R, 2), integers
        Index of the first sample of each ray, and the number of its samples, which may be 0.
    stop : float, default 0.0001
        A ray ends where at most this share of the light is left; 0 uses all samples.
    check : bool, default True
        Check that `spans` are within the samples. On a GPU the host waits for this. A call that
        :func:`cvkern.capture` records on a GPU needs False, and correct spans.

    Returns
    -------
    Composite
        Named tuple of `color` (R, 3), `opacity`, `depth` and `distortion` (R,), float32.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `spans` not integers.
    ValueError
        If an array has another shape, arrays are on several devices, `stop` is negative or not
        finite, or `spans` has 2^26 rows or more, or rows outside the samples.

    Notes
    -----
    Contiguous float32 arrays (spans: int32) are read without a copy. Samples of no ray are not
    read; a NaN affects only its own ray. With a background b, the colour is
    ``color + (1 - opacity)[:, None] * b``; the mean distance is ``depth / opacity``.

    The distortion is ``sum_ij w_i w_j |t_i - t_j| + sum_i w_i^2 d_i / 3``. For samples in the
    middle of their lengths, this is equation 15 of [2]_.

    References
    ----------
    .. [1] B. Mildenhall, P. P. Srinivasan, M. Tancik, J. T. Barron, R. Ramamoorthi and R. Ng,
       "NeRF: representing scenes as neural radiance fields for view synthesis", ECCV 2020,
       equation 3.
    .. [2] J. T. Barron, B. Mildenhall, D. Verbin, P. P. Srinivasan and P. Hedman, "Mip-NeRF 360:
       unbounded anti-aliased neural radiance fields", CVPR 2022.

    Examples
    --------
    One ray with two samples, and one without samples:

    >>> import numpy as np
    >>> from cvkern.radiance import composite_rays
    >>> density, color = np.log([2, 2]), np.array([[1, 0, 0], [0, 0, 1]])
    >>> seen = composite_rays(density, color, [[2, 1], [3, 1]], [[0, 2], [2, 0]])
    >>> seen.color
    array([[0.5 , 0.  , 0.25],
           [0.  , 0.  , 0.  ]], dtype=float32)
    >>> seen.opacity
    array([0.75, 0.  ], dtype=float32)
    """
    check = check_flag(check, "check")
    samples = _samples(density, color, distances, spans)
    stop = check_number(stop, "stop", low=0)
    rt = runtime(*samples)
    if check:
        _check_spans(rt, spans, len(samples.density), apart=False)
    rays = len(samples.spans)
    results = Composite(
        rt.empty((rays, 3)), rt.empty((rays,)), rt.empty((rays,)), rt.empty((rays,))
    )
    views = Composite(*(rt.adopt(a) for a in results))
    if rays and len(samples.density):
        rt.radiance.compositing.forward(*_adopted(rt, samples), stop, Composited(*views))
    else:
        for view in views:
            rt.clear(view)
    return Composite(*(rt.release(a) for a in results))


def composite_rays_backward(
    gradients: Composite,
    density: Any,
    color: Any,
    distances: Any,
    spans: Any,
    *,
    stop: float = STOP,
    check: bool = True,
) -> CompositeGradient:
    """Compute gradients of a loss by the samples from its gradients by the composited rays.

    Parameters
    ----------
    gradients : Composite
        Gradients by the results of :func:`composite_rays` for the following arguments, with the
        shapes of its fields; None for a field that has no part in the loss.
    density, color, distances, spans, stop, check
        As given to :func:`composite_rays`. No sample may belong to two rays.

    Returns
    -------
    CompositeGradient
        Named tuple of `density` (M,) and `color` (M, 3), float32; 0 for samples of no ray, and for
        samples behind the end of a ray.

    Raises
    ------
    TypeError
        As :func:`composite_rays`; also if `gradients` is no tuple of four.
    ValueError
        As :func:`composite_rays`; also if a gradient has another shape, or spans overlap.

    Notes
    -----
    The weights are computed again along each ray instead of stored. Distances have no gradients.
    The end of a ray by `stop` is treated as constant: it has no derivative by the samples.

    Examples
    --------
    The derivatives of the opacity, 1 - exp(-s_1 d_1 - s_2 d_2), by both densities:

    >>> import numpy as np
    >>> from cvkern.radiance import Composite, composite_rays_backward
    >>> opaque = Composite(None, np.ones(1), None, None)
    >>> samples = np.log([2, 2]), np.ones((2, 3)), [[2, 1], [3, 1]], [[0, 2]]
    >>> composite_rays_backward(opaque, *samples).density
    array([0.25, 0.25], dtype=float32)
    """
    check = check_flag(check, "check")
    samples = _samples(density, color, distances, spans)
    stop = check_number(stop, "stop", low=0)
    incoming = _incoming(gradients, len(samples.spans))
    rt = runtime(*incoming, *samples)
    count = len(samples.density)
    if check:
        _check_spans(rt, spans, count, apart=True)
    results = CompositeGradient(rt.empty((count,)), rt.empty((count, 3)))
    views = CompositeGradient(*(rt.adopt(a) for a in results))
    for view in views:  # the kernels leave out samples of no ray
        rt.clear(view)
    if count and len(samples.spans):
        carried = []
        for name, values in zip(Composite._fields, incoming, strict=True):
            if values is None:
                shape = _shape(name, len(samples.spans))
                carried.append(rt.scratch(f"composite_rays_backward.{name}", shape))
                rt.clear(carried[-1])
            else:
                carried.append(rt.adopt(values))
        rt.radiance.compositing.backward(Composited(*carried), *_adopted(rt, samples), stop, *views)
    return CompositeGradient(*(rt.release(a) for a in results))


class _Samples(NamedTuple):
    density: Any
    color: Any
    distances: Any
    spans: Any


def _samples(density: Any, color: Any, distances: Any, spans: Any) -> _Samples:
    """Return the arguments as arrays, with their shapes checked."""
    density, spans = as_array(density, "density"), as_array(spans, "spans")
    if len(density.shape) != 1:
        raise ValueError(f"density must be 1-D, got shape {tuple(density.shape)}")
    count = len(density)
    density = check_beside(density, (count,), "density")
    color = check_beside(as_array(color, "color"), (count, 3), "color")
    distances = check_beside(as_array(distances, "distances"), (count, 2), "distances")
    if len(spans.shape) != 2 or spans.shape[1] != 2:
        raise ValueError(f"spans must have shape (R, 2), got {tuple(spans.shape)}")
    dtype = library(spans).dtype(spans)
    if dtype.kind not in "iu":
        raise TypeError(f"spans must hold integers, got dtype {dtype}")
    if len(spans) > MOST_RAYS:
        raise ValueError(f"spans must have at most {MOST_RAYS} rows, got {len(spans)}")
    return _Samples(density, color, distances, spans)


def _shape(name: str, rays: int) -> tuple[int, ...]:
    return (rays, 3) if name == "color" else (rays,)


def _incoming(gradients: Any, rays: int) -> list[Any]:
    """Return the gradients by each field of :class:`Composite`, or None."""
    if not isinstance(gradients, tuple) or len(gradients) != len(Composite._fields):
        raise TypeError(f"gradients must be a Composite, got {type(gradients).__name__}")
    return [
        check_beside(values, _shape(name, rays), f"gradients.{name}")
        for name, values in zip(Composite._fields, gradients, strict=True)
    ]


def _check_spans(rt: Runtime, spans: Any, count: int, *, apart: bool) -> None:
    """Refuse spans outside the `count` samples and, if they must be apart, overlapping spans."""
    on_host = device(spans) == "cpu"
    rows = np.asarray(spans) if on_host else rt.to_numpy(rt.adopt(spans, np.int32))
    first, number = rows.astype(np.int64).T
    wrong = (number < 0) | ((number > 0) & ((first < 0) | (first + number > count)))
    if wrong.any():
        ray = int(wrong.argmax())
        raise ValueError(
            f"spans must be rows of the {count} samples, got {number[ray]} from {first[ray]} on "
            f"for ray {ray}"
        )
    if apart:
        rays = np.flatnonzero(number)
        rays = rays[np.argsort(first[rays], kind="stable")]
        both = first[rays[1:]] < (first + number)[rays[:-1]]
        if both.any():
            k = int(both.argmax())
            raise ValueError(
                f"spans must not overlap, got row {first[rays[k + 1]]} for rays {rays[k]} and "
                f"{rays[k + 1]}"
            )


def _adopted(rt: Runtime, samples: _Samples) -> _Samples:
    """View the samples for kernels."""
    density, color, distances, spans = samples
    return _Samples(
        rt.adopt(density), rt.adopt(color), rt.adopt(distances), rt.adopt(spans, np.int32)
    )
