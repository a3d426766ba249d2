"""How different two colours look."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_image, check_positive
from cvkern._runtime import runtime


def deltaE_ciede2000(lab1: Any, lab2: Any, kL: float = 1, kC: float = 1, kH: float = 1) -> Any:
    """Return the CIEDE2000 difference of colours.

    Parameters
    ----------
    lab1, lab2 : array of shape (..., 3)
        Colours in L*a*b*, of one shape: points, lists or images.
    kL, kC, kH : float, default 1
        Weights of lightness, chroma and hue, above 0: 2 for `kL` in the textile industry.

    Returns
    -------
    array of shape (...), float32
        Differences; 1 is about what can just be seen. Worked out in float64.

    Raises
    ------
    TypeError
        If an array or a weight does not hold real numbers.
    ValueError
        If the last axis is not 3 long, shapes differ, or a weight is not above 0.

    References
    ----------
    .. [1] G. Sharma, W. Wu and E. N. Dalal, "The CIEDE2000 color-difference formula: implementation
       notes, supplementary test data, and mathematical observations", Color Research and
       Application 30, 2005.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.deltaE_ciede2000([[50, 2.6772, -79.7751]], [[50, 0, -82.7485]]).round(4)
    array([2.0425], dtype=float32)
    """
    lab1 = check_image(lab1, ndim=(1, 2, 3), name="lab1")
    lab2 = check_image(lab2, ndim=(1, 2, 3), name="lab2")
    if lab1.shape[-1] != 3:
        raise ValueError(f"lab1 must have shape (..., 3), got {tuple(lab1.shape)}")
    if tuple(lab1.shape) != tuple(lab2.shape):
        raise ValueError(
            f"lab2 must have the shape of lab1, {tuple(lab1.shape)}, got {tuple(lab2.shape)}"
        )
    weights = check_positive(kL, "kL"), check_positive(kC, "kC"), check_positive(kH, "kH")
    rt = runtime(lab1, lab2)
    shape = tuple(lab1.shape[:-1])
    count = int(np.prod(shape))
    result = rt.empty(shape)
    rt.color.differences.ciede2000(
        rt.adopt(lab1, np.float32, (count, 3)), rt.adopt(lab2, np.float32, (count, 3)),
        *weights, rt.adopt(result, np.float32, (count,)),
    )  # fmt: skip
    return rt.release(result)
