"""Colour images, read channel by channel.

The gradient of a colour image at a pixel is that of the channel where it is longest; of equal ones,
the first channel's. This is the rule of :func:`cv2.Canny`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._runtime import Runtime
from cvkern.filters.depths import as_floats
from cvkern.kernels.codes.edges import Norm

COLORS = 3  # channels of a colour; a fourth one is alpha, which is ignored


class Planes(NamedTuple):
    """The channels of an image as kernel arrays."""

    values: tuple[Any, ...]
    """One array (H, W), or (N, H, W) of a stack, float32 or uint8, for each channel."""
    dtype: np.dtype
    """The dtype of the caller's image."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width, after the number of images of a stack."""
        return tuple(self.values[0].shape)


def planes_of(
    rt: Runtime, image: Any, dtype: Any = np.float32, batch_axis: int | None = None
) -> Planes:
    """Read an image (H, W), or (H, W, 3 or 4) as a colour image, as planes of `dtype`."""
    if isinstance(image, Planes):
        return image
    given = library(image).dtype(image)
    src = as_floats(rt, image) if dtype is np.float32 else rt.adopt(image, dtype)
    if len(image.shape) == (2 if batch_axis is None else 3):
        return Planes((src,), given)
    *shape, width, channels = image.shape
    height = math.prod(shape)  # rows of all images of a stack
    kind = np.dtype(dtype).name
    planes = rt.scratch(f"channels.planes.{kind}", (COLORS, height, width), dtype)
    rt.filters.channels.split(src.reshape((height, width, channels)), planes)
    return Planes(tuple(planes[c].reshape((*shape, width)) for c in range(COLORS)), given)


def longest_slopes(
    rt: Runtime,
    planes: Planes,
    differentiate: Callable[[Any, Any, Any], None],
    dy: Any,
    dx: Any,
    norm: Norm = Norm.L2,
) -> None:
    """Fill dy and dx with the longest of the gradients that `differentiate` fills for a plane."""
    if len(planes.values) == 1:
        differentiate(planes.values[0], dy, dx)
        return
    dys, dxs = (rt.scratch(f"channels.{name}", (COLORS, *planes.shape)) for name in ("dy", "dx"))
    for c, plane in enumerate(planes.values):
        differentiate(plane, dys[c], dxs[c])
    *shape, width = dy.shape
    one = math.prod(shape), width  # the rows of all images of a stack
    downs, alongs = (a.reshape((COLORS, *one)) for a in (dys, dxs))
    rt.filters.channels.longest(downs, alongs, norm, dy.reshape(one), dx.reshape(one))
