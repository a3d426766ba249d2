"""From radiance of any range to the range of a screen."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_image, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern.filters.linear import gaussian_taps
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.raw import SLOTS, STEPS
from cvkern.raw.bands import local_laplacian
from cvkern.raw.grids import bilateral

SMALLEST = 2.0**-126  # factor of radiance: Taichi takes smaller ones for 0
MOST_STOPS = 120  # logarithm of light to the base of 2: factors of more are denormal
METHODS = ("reinhard", "reinhard_local", "bilateral", "local_laplacian")
SHARPNESS, SCALES = 8.0, 8  # Reinhard's phi, and his number of scales
RANGE = 0.4 * math.log2(10)  # standard deviation in stops of the bilateral filter
DETAIL = math.log2(2.5)  # stops of a variation that is a detail, not an edge
MOST_REFERENCES = 64
WHITE, SAMPLES = 0.995, 2**16  # share of pixels below white, of so many on a grid


def tone_map(
    radiance: Any, method: str = "reinhard", *, key: float = 0.18, contrast: float = 5.0
) -> Any:
    """Map radiance to linear values in 0 to 1.

    Parameters
    ----------
    radiance : array of shape (H, W) or (H, W, 3)
        Radiance at any scale, as of `merge_exposures`.
    method : str, default 'reinhard'
        'reinhard': one curve for the whole picture [1]_. 'reinhard_local': one that looks at the
        surroundings of each pixel, as dodging and burning do [1]_. 'bilateral': the picture,
        smoothed within its edges, is compressed, and what this took off is kept [2]_.
        'local_laplacian': edges shrink at every scale, details stay, and there are no halos [3]_.
    key : float, default 0.18
        For Reinhard's: what the mean of the logarithms becomes, above 0: larger is brighter.
    contrast : float, default 5.0
        For the others: factor that is left of all between the brightest and the darkest, above 0;
        of edges alone, for 'local_laplacian'.

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
    Luminance is mapped and colours are scaled with it; what is negative or not finite is black. The
    bilateral filter works on a grid of space and brightness, with standard deviations of 2 % of
    the larger side and of 0.4 in log10. The local Laplacian filter takes variations up to a factor
    of 2.5 for details, as its authors do, and is computed at references that far apart, with
    straight lines between these [4]_; its white is reached by half a percent of the pixels. Sums
    are those of integers, so that results are equal in every bit on all devices.

    References
    ----------
    .. [1] E. Reinhard, M. Stark, P. Shirley and J. Ferwerda, "Photographic tone reproduction for
       digital images", SIGGRAPH 2002.
    .. [2] F. Durand and J. Dorsey, "Fast bilateral filtering for the display of high-dynamic-range
       images", SIGGRAPH 2002; J. Chen, S. Paris and F. Durand, "Real-time edge-aware image
       processing with the bilateral grid", SIGGRAPH 2007.
    .. [3] S. Paris, S. W. Hasinoff and J. Kautz, "Local Laplacian filters: edge-aware image
       processing with a Laplacian pyramid", SIGGRAPH 2011.
    .. [4] M. Aubry, S. Paris, S. W. Hasinoff, J. Kautz and F. Durand, "Fast local Laplacian
       filters: theory and applications", ACM Transactions on Graphics 33, 2014.

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
    shape = tuple(radiance.shape)
    light = rt.adopt(radiance, np.float32, (*shape[:2], 3 if len(shape) == 3 else 1))
    logs = rt.scratch("tone.logs", shape[:2])
    sums = _cleared(rt)
    rt.raw.tone.survey(light, logs, sums)
    ends = _ends(rt, sums)
    if not ends.pixels:
        return rt.give(np.zeros(shape, np.float32))
    if ends.high > MOST_STOPS:
        raise ValueError(f"radiance must be at most 2^{MOST_STOPS}, got some of 2^{ends.high:.0f}")
    result = rt.empty(shape)
    out = rt.adopt(result, np.float32, tuple(light.shape))
    if method.startswith("reinhard"):
        _curved(rt, light, key, ends, method == "reinhard_local", out)
    else:
        if ends.pixels < shape[0] * shape[1]:
            rt.raw.tone.limit(ends.low, logs.reshape((logs.size,)))
        shrink = _smoothed if method == "bilateral" else _layered
        one, own, two, other, offset = shrink(rt, logs, ends, math.log2(contrast))
        rt.raw.tone.show(light, one, own, two, other, offset, out)
    return rt.release(result)


class Ends(NamedTuple):
    """What logarithms to the base of 2 extend over, where there is light."""

    mean: float
    low: float
    high: float
    pixels: int

    def share(self, contrast: float) -> float:
        """Return how much of the span is left, if it must not exceed a contrast in stops."""
        span = self.high - self.low
        return min(1.0, contrast / span) if span > 0 else 1.0


def _cleared(rt: Runtime) -> Any:
    sums = rt.scratch("tone.sums", (SLOTS, 4), np.int64)
    rt.clear(sums)
    return sums


def _ends(rt: Runtime, sums: Any) -> Ends:
    found = np.array(rt.to_numpy(sums))
    total, count = (int(n) for n in found[:, :2].sum(axis=0))
    low, high = 2**32 - int(found[:, 2].max()), int(found[:, 3].max()) - 2**32
    return Ends(total / STEPS / max(count, 1), low / STEPS, high / STEPS, count)


def _curved(rt: Runtime, light: Any, key: float, ends: Ends, local: bool, out: Any) -> None:
    """Apply Reinhard's curve, of the whole picture or of the surroundings of each pixel."""
    shape = tuple(light.shape[:2])
    scale = max(key / 2**ends.mean, SMALLEST)
    around = rt.scratch("tone.around", (shape[0] * shape[1],) if local else (1,))
    if local:
        scaled, *smooth = (rt.scratch(f"tone.scale{n}", (1, *shape)) for n in range(3))
        kept = rt.scratch("tone.open", tuple(around.shape), np.uint8)
        rt.raw.tone.luminance(light, scale, scaled[0])
        for n in range(SCALES + 1):
            taps = rt.constant(gaussian_taps(0.35 * 1.6**n))
            rt.filters.linear.correlate_separable(
                scaled, taps, taps, 1, Border.REFLECT, 0.0, smooth[n % 2]
            )
            if n:
                before, wider = (smooth[k % 2].reshape(around.shape) for k in (n - 1, n))
                level = 2**SHARPNESS * key / 1.6 ** (2 * n - 2)
                rt.raw.tone.widen(before, wider, level, int(n > 1), around, kept)
    flat = (shape[0] * shape[1], light.shape[2])
    white = 0.0 if local else scale * 2**ends.high
    rt.raw.tone.curve(light.reshape(flat), around, scale, white, out.reshape(flat))


def _smoothed(rt: Runtime, logs: Any, ends: Ends, contrast: float) -> tuple[Any, ...]:
    """Compress the image that a bilateral filter smoothed; its brightest value becomes white."""
    sigma = max(2.0, 0.02 * max(logs.shape))
    sums = _cleared(rt)
    base = bilateral(rt, logs, ends.low, ends.high - ends.low, sigma, RANGE, sums)
    own = _ends(rt, sums)
    share = own.share(contrast)
    return base, share - 1, base, 0.0, -share * own.high


def _layered(rt: Runtime, logs: Any, ends: Ends, contrast: float) -> tuple[Any, ...]:
    """Shrink edges by a local Laplacian filter; the brightest pixels but a few become white."""
    found, span = logs, ends.high - ends.low
    if span > 0:
        count = min(math.ceil(span / DETAIL) + 1, MOST_REFERENCES)
        image = logs.reshape((1, *logs.shape))
        found = local_laplacian(
            rt, image, ends.low, span / (count - 1), count, DETAIL, ends.share(contrast)
        ).reshape(logs.shape)
    step = max(1, math.ceil(math.sqrt(logs.size / SAMPLES)))
    few = rt.scratch("tone.few", tuple(-(-n // step) for n in logs.shape))
    rt.transform.pyramids.thin(found, step, few)
    values = np.sort(rt.to_numpy(few), axis=None)
    white = float(values[min(int(WHITE * values.size), values.size - 1)])
    return found, 1.0, logs, -1.0, -white
