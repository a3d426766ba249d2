"""From radiance of any range to what a screen can show."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_choice, check_image, check_positive
from cvkern._runtime import runtime

METHODS = ("reinhard", "reinhard_local", "bilateral")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # weights of linear sRGB
EDGE, SHARPNESS, SCALES = 0.05, 8.0, 8  # Reinhard's: difference of scales, phi, and their number
RANGE = 0.4  # standard deviation in log10 of the bilateral filter


def tone_map(
    radiance: Any, method: str = "reinhard", *, key: float = 0.18, contrast: float = 5.0
) -> Any:
    """Map radiance to linear values in 0 to 1.

    Parameters
    ----------
    radiance : array of shape (H, W) or (H, W, 3)
        Radiance at any scale, as of `merge_exposures`.
    method : {'reinhard', 'reinhard_local', 'bilateral'}, default 'reinhard'
        One curve for the whole picture [1]_, one that looks at the surroundings of each pixel, as
        dodging and burning do [1]_, or details kept while the smoothed rest is compressed [2]_.
    key : float, default 0.18
        What the mean of the logarithms becomes, above 0: larger is brighter.
    contrast : float, default 5.0
        For 'bilateral': factor between the brightest and the darkest of the smoothed picture.

    Returns
    -------
    array of the same shape, float32
        Linear values in 0 to 1: `convert_color` from 'rgb' to 'srgb' makes them fit for a screen.

    Raises
    ------
    TypeError
        If `radiance` does not hold real numbers.
    ValueError
        If it is of another shape, the method is unknown, or a number is not above 0.

    Notes
    -----
    Luminance is mapped and colours are scaled with it; what is negative or not finite is black. It
    is made on the host, and equal on all devices. The bilateral filter works on a grid of space and
    brightness, which is filled in float64 in the order of the pixels.

    References
    ----------
    .. [1] E. Reinhard, M. Stark, P. Shirley and J. Ferwerda, "Photographic tone reproduction for
       digital images", SIGGRAPH 2002.
    .. [2] F. Durand and J. Dorsey, "Fast bilateral filtering for the display of high-dynamic-range
       images", SIGGRAPH 2002; J. Chen, S. Paris and F. Durand, "Real-time edge-aware image
       processing with the bilateral grid", SIGGRAPH 2007.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.tone_map(np.array([[0.01, 1.0, 100.0]])).round(3)
    array([[0.002, 0.153, 1.   ]], dtype=float32)
    """
    radiance = check_image(radiance, ndim=(2, 3), name="radiance")
    if len(radiance.shape) == 3 and radiance.shape[2] != 3:
        raise ValueError(f"radiance must have 1 or 3 channels, got shape {tuple(radiance.shape)}")
    check_choice(method, METHODS, "method")
    key, contrast = check_positive(key, "key"), check_positive(contrast, "contrast")
    rt = runtime(radiance)
    light = np.array(rt.to_numpy(rt.adopt(radiance)), np.float32)
    light = np.where(np.isfinite(light), light, 0).clip(0)
    luminance = light if light.ndim == 2 else light @ LUMINANCE
    seen = luminance > 0
    if not seen.any():
        return rt.give(np.zeros_like(light))
    mean = np.exp(np.mean(np.log(luminance[seen].astype(np.float64))))
    scaled = luminance * np.float32(key / mean)
    if method == "reinhard":
        white = scaled.max()
        shown = scaled * (1 + scaled / white**2) / (1 + scaled)
    elif method == "reinhard_local":
        shown = scaled / (1 + _surround(scaled, key))
    else:
        shown = _compressed(luminance, seen, contrast)
    ratio = np.divide(shown, luminance, out=np.zeros_like(luminance), where=seen)
    found = light * (ratio if light.ndim == 2 else ratio[..., None])
    return rt.give(np.ascontiguousarray(found.clip(0, 1), np.float32))


def _surround(scaled: np.ndarray, key: float) -> np.ndarray:
    """Return the mean of the largest surroundings of each pixel that has no edge in it."""
    from scipy.ndimage import gaussian_filter

    found = centre = gaussian_filter(scaled, 0.35)
    open_still = np.ones(scaled.shape, bool)
    for n in range(SCALES):
        scale = 1.6**n
        wider = gaussian_filter(scaled, 0.35 * scale * 1.6)
        flat = np.abs(centre - wider) < EDGE * (2**SHARPNESS * key / scale**2 + centre)
        open_still &= flat
        found = np.where(open_still, wider, found)
        centre = wider
    return found


def _compressed(luminance: np.ndarray, seen: np.ndarray, contrast: float) -> np.ndarray:
    """Compress what a bilateral filter leaves of the logarithm, and keep the details."""
    logs = np.log10(np.maximum(luminance, luminance[seen].min()))
    base = _bilateral(logs, max(2.0, 0.02 * max(logs.shape)), RANGE)
    span = float(np.ptp(base))
    factor = min(1.0, np.log10(contrast) / span) if span > 0 else 1.0
    return 10 ** (factor * (base - base.max()) + (logs - base))


def _bilateral(values: np.ndarray, sigma: float, reach: float) -> np.ndarray:
    """Smooth by a bilateral filter, on a grid with a cell for each sigma and each reach."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    rows, columns = np.indices(values.shape)
    places = np.stack([rows / sigma + 2, columns / sigma + 2, (values - values.min()) / reach + 2])
    cells = np.floor(places + 0.5).astype(np.int64)
    shape = tuple(int(c.max()) + 3 for c in cells)
    flat = np.ravel_multi_index(tuple(c.ravel() for c in cells), shape)
    size = int(np.prod(shape))
    sums = np.bincount(flat, values.ravel().astype(np.float64), size).reshape(shape)
    counts = np.bincount(flat, minlength=size).reshape(shape).astype(np.float64)
    sums, counts = (gaussian_filter(g, 1.0, mode="constant") for g in (sums, counts))
    top, bottom = (map_coordinates(g, places, order=1) for g in (sums, counts))
    return (top / np.maximum(bottom, 1e-12)).astype(np.float32)
