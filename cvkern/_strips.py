"""Images of the host with more elements than kernels can index, computed strip by strip."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from cvkern._checks import MAX_ELEMENTS

P = ParamSpec("P")
R = TypeVar("R")
_MOST = 2**16  # rows and columns of a strip, the largest tile of :func:`cvkern.scale.apply`


def in_strips(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function compute NumPy images of any size; its first argument is the image.

    Strips have all columns, up to 65536, and as many rows as give an eighth of the elements that a
    kernel can index. The bits are those of the whole image (:func:`cvkern.scale.apply`).
    """
    name = function.__name__
    signature = inspect.signature(function)

    @functools.wraps(function)
    def sized(*args: P.args, **options: P.kwargs) -> R:
        image = args[0] if args else options.get("image")
        if not isinstance(image, np.ndarray) or image.size <= MAX_ELEMENTS:
            return function(*args, **options)
        given = signature.bind(*args, **options).arguments
        if given.get("batch_axis") is not None:
            return function(*args, **options)  # refuses the stack
        from cvkern.scale import apply

        source, target = given.pop("image"), given.pop("out", None)
        rows = max(1, min(MAX_ELEMENTS // 8 * len(image) // image.size, _MOST))
        return apply(name, source, target, tile=(rows, min(image.shape[1], _MOST)), **given)

    return sized
