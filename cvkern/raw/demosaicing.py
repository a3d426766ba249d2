"""From the samples of a Bayer filter to three colours at each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_image
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.raw import MARGIN, Linear, Step
from cvkern.raw.mosaics import red_place

CARRIED = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
METHODS = ("bilinear", "malvar", "menon", "residual")
STRIP = {"cpu": 256, "cuda": 4096}  # rows that are worked on at once: even


def demosaic(raw: Any, pattern: str = "RGGB", method: str = "residual") -> Any:
    """Interpolate the two colours that each pixel behind a Bayer filter misses.

    Parameters
    ----------
    raw : array of shape (H, W)
        Samples, at least 2 x 2, uint8, uint16 or floating.
    pattern : {'RGGB', 'BGGR', 'GRBG', 'GBRG'}, default 'RGGB'
        Colours of the cell of 2 x 2 pixels at the top left, row by row.
    method : {'residual', 'menon', 'malvar', 'bilinear'}, default 'residual'
        How: by the local relation between colours, by the smoother direction, by fixed filters of
        5 x 5 samples, or by means of neighbours. Each is faster than the one before it. 'residual'
        is nearest to the truth; in saturated colours, 'malvar' is nearer than 'menon'.

    Returns
    -------
    array of shape (H, W, 3)
        Red, green and blue, of the dtype of `raw`. Measured samples are kept, except by the last
        pass of 'menon'. Integers are rounded half up and limited to the dtype; floats are not
        limited. float16 and float64 are computed in float32. For all other dtypes, every bit is
        equal on all devices.

    Raises
    ------
    TypeError
        If `raw` is neither uint8, uint16 nor floating.
    ValueError
        If `raw` is not 2-D, has a side of one pixel, or an option is not one of those above.

    See Also
    --------
    mosaic : The way back.

    Notes
    -----
    'residual' is cvkern's own. Like residual interpolation [3]_, it fits a line between green and
    the other colour in windows around each pixel, along rows and along columns, and interpolates
    the residuals. It differs in three ways. First, the slope has a prior of 1 with the weight of
    the residuals, so where colours are hardly correlated, their edges count as equal. Second,
    differences between colours are smoothed more where texture explains their changes. Third, a
    direction weighs more if these differences change little along it, as does a pair of neighbours
    where red and blue are interpolated. The result scales with the values. Borders are mirrored.

    References
    ----------
    .. [1] H. S. Malvar, L. He and R. Cutler, "High-quality linear interpolation for demosaicing of
       Bayer-patterned color images", ICASSP 2004.
    .. [2] D. Menon, S. Andriani and G. Calvagno, "Demosaicing with directional filtering and a
       posteriori decision", IEEE Transactions on Image Processing 16, 2007.
    .. [3] D. Kiku, Y. Monno, M. Tanaka and M. Okutomi, "Beyond color difference: residual
       interpolation for color image demosaicking", IEEE Transactions on Image Processing 25, 2016.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> grey = np.full((4, 6), 7, np.uint8)
    >>> cvkern.demosaic(grey)[1, 2]
    array([7, 7, 7], dtype=uint8)
    """
    raw = check_image(raw, name="raw")
    place = red_place(pattern)
    method = check_choice(method, METHODS, "method")
    dtype = library(raw).dtype(raw)
    if dtype not in CARRIED and dtype.kind != "f":
        raise TypeError(f"raw must be uint8, uint16 or floating, got {dtype}")
    if min(raw.shape) < 2:
        raise ValueError(f"raw must have sides of at least 2 pixels, got {tuple(raw.shape)}")
    rt = runtime(raw)
    carried = dtype if dtype in CARRIED else np.dtype(np.float32)
    samples = rt.adopt(raw, carried)
    result = rt.empty((*raw.shape, 3), carried)
    colours = rt.adopt(result, carried)
    if method in ("bilinear", "malvar"):
        code = int(Linear[method.upper()])
        rt.raw.demosaicing.linear.interpolate(samples, *place, code, colours)
    elif method == "menon":
        rt.raw.demosaicing.menon.menon(samples, *place, colours)
    else:
        _residual(rt, samples, place, colours)
    found = rt.release(result)
    return found if carried == dtype else library(found).contiguous(found, dtype)


def _residual(rt: Runtime, samples: Any, place: tuple[int, int], colours: Any) -> None:
    """Fill planes of a strip of rows after the other, and put its colours into the result."""
    height, width = samples.shape
    most = STRIP[rt.device.partition(":")[0]]
    kernels = rt.raw.demosaicing
    for top in range(0, height, most):
        rows = min(most, height - top)
        shape = (10, rows + 2 * MARGIN, width + 2 * MARGIN)
        planes = rt.scratch("demosaic.planes", shape)
        kernels.planes.extend(samples, top, planes)
        kernels.residual.directions(*place, planes)
        kernels.residual.green(*place, planes)
        for plane, (row, column) in ((1, place), (2, (1 - place[0], 1 - place[1]))):
            for step in Step:
                kernels.residual.chroma(int(step), row, column, plane, planes)
        kernels.planes.join(planes, 1, 3, 2, top, rows, colours)
