"""How far around a pixel the functions look that can work tile by tile."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import cvkern
from cvkern._checks import as_numbers, check_integer, check_number, check_pair
from cvkern.filters.linear import check_radius
from cvkern.hough.circles.votes import MAX_RADIUS
from cvkern.stereo._strips import OVERLAP
from cvkern.stereo.windows import RADII, SPACING

Options = Mapping[str, Any]


def _largest(options: Options, name: str) -> float:
    return max(check_number(value, name, low=0) for value in check_pair(options[name], name))


def _taps(options: Options) -> int:
    taps = options["taps"]
    nested = len(taps) == 2 and not np.isscalar(taps[0]) and np.ndim(taps[0])
    return max(len(t) for t in (taps if nested else (taps,))) // 2


def _spread(options: Options, truncate: Any = 4.0) -> int:
    radius = check_number(truncate, "truncate", low=0) * _largest(options, "sigma")
    check_radius(radius)
    return int(radius + 0.5)


def _radii(options: Options) -> int:
    given = as_numbers(options["radius"], "radius", object).reshape(-1).tolist()
    return max((check_integer(r, "radius", 1, MAX_RADIUS) for r in given), default=1)


def _matched(options: Options) -> int:
    """Return on how many rows a disparity depends; paths, which have no end, are cut off."""
    census = RADII[0] * SPACING
    window = check_integer(options["window"], "window", 1, 2**16) // 2
    reach = OVERLAP if options["method"] == "semi-global" else window + census
    return reach + check_integer(options["smoothing"], "smoothing", 0, 2**16)


_HALOS: dict[str, Callable[[Options], int]] = {
    "box": lambda options: int(_largest(options, "radius")),
    # The Gaussian, the operator, the comparison with neighbours, and the rim without edges.
    "canny": lambda options: _spread(options) + 3,
    "correlate_separable": _taps,
    "gaussian": lambda options: _spread(options, options["truncate"]),
    "generalized_hough": lambda _: 0,
    "generalized_hough_votes": lambda _: 0,
    "gradient": lambda options: _spread(options) + 1,
    "hough_circle": _radii,
    "hough_line": lambda _: 0,
    "laplace": lambda _: 2,
    "median": lambda options: int(_largest(options, "radius")),
    "prewitt": lambda _: 2,
    "scharr": lambda _: 2,
    "sobel": lambda _: 2,
    "sobel_h": lambda _: 2,
    "sobel_v": lambda _: 2,
    "stereo_match": _matched,
}

TILED = tuple(sorted(_HALOS))
"""The functions that :func:`apply` knows."""


def halo(function: Any, **options: Any) -> int:
    """Return how many pixels around a tile a function reads.

    Parameters
    ----------
    function : function or str
        One of `TILED`, or its name.
    **options
        As the function takes them.

    Returns
    -------
    int
        Pixels. With at least so many around it, or the image's border, the inside of a tile is that
        of the whole image in every bit; of `stereo_match`, as :func:`apply` says.

    Raises
    ------
    TypeError
        If the function does not have an option.
    ValueError
        If the function does not work tile by tile, or an option has no meaning there.

    Examples
    --------
    >>> from cvkern.scale import halo
    >>> halo("gaussian", sigma=3), halo("median", radius=2)
    (12, 2)
    """
    name = function if isinstance(function, str) else getattr(function, "__name__", "")
    if name not in _HALOS or (callable(function) and function is not getattr(cvkern, name)):
        raise ValueError(f"function must be one of {', '.join(TILED)}, got {name or function!r}")
    try:
        images = (None,) * (2 if name == "stereo_match" else 1)
        bound = inspect.signature(getattr(cvkern, name)).bind(*images, **options)
    except TypeError as error:
        raise TypeError(f"options must be those of {name}: {error}") from None
    bound.apply_defaults()
    given = bound.arguments
    refused = {
        "mode": given.get("mode") == "wrap",
        "batch_axis": given.get("batch_axis") is not None,
        "out": given.get("out") is not None,
        "channel_axis": given.get("channel_axis") not in (None, -1, 2),
        "full_output": bool(given.get("full_output")),
        "points": given.get("points") is not None,
    }
    for option, wrong in refused.items():
        if wrong:
            raise ValueError(f"{option} must not be {given[option]!r} in tiles: {_REASONS[option]}")
    reach = _HALOS[name](given)
    if not 0 <= reach < math.inf:
        raise ValueError(f"options of {name} must be valid, got a reach of {reach}")
    return reach


_REASONS = {
    "mode": "a tile at one border does not see the other",
    "batch_axis": "pass the images one by one",
    "out": "pass target",
    "channel_axis": "channels must be the last axis",
    "full_output": "centres outside the image belong to no tile",
    "points": "pass a mask",
}
