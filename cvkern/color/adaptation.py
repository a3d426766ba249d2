"""How colours look under another light: matrices of adaptation."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_choice
from cvkern.color.spaces import apply_matrix
from cvkern.color.spectra import white_point

# From XYZ to the responses that adapt, each on its own.
RESPONSES = {
    "von_kries": ((0.40024, 0.7076, -0.08081), (-0.2263, 1.16532, 0.0457), (0.0, 0.0, 0.91822)),
    "bradford": ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296)),
    "cat16": (
        (0.401288, 0.650173, -0.051461),
        (-0.250268, 1.204414, 0.045854),
        (-0.002079, 0.048952, 0.953127),
    ),
}


def adaptation_matrix(source: Any, target: Any, method: str = "bradford") -> np.ndarray:
    """Return the matrix that takes XYZ under one light to how it looks under another.

    Parameters
    ----------
    source, target : str or (X, Y, Z)
        The lights: names of `standard_light`, or their white points.
    method : {'bradford', 'cat16', 'von_kries'}, default 'bradford'
        In what responses whites are equalled: those of Bradford [1]_ or CAT16 [2]_, or the cones of
        Hunt, Pointer and Estevez.

    Returns
    -------
    (3, 3) float64
        Acts on (X, Y, Z).

    Raises
    ------
    TypeError
        If a white point is not of numbers.
    ValueError
        If it is not three positive numbers, or a name is unknown.

    References
    ----------
    .. [1] K. M. Lam, "Metamerism and colour constancy", PhD thesis, Bradford, 1985.
    .. [2] C. Li et al., "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
       Research and Application 42, 2017.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.adaptation_matrix("D65", "D50").round(4)
    array([[ 1.0478,  0.0229, -0.0501],
           [ 0.0296,  0.9905, -0.0171],
           [-0.0092,  0.015 ,  0.7521]])
    """
    check_choice(method, tuple(RESPONSES), "method")
    to = np.array(RESPONSES[method])
    before, after = (to @ white_point(w, n) for w, n in ((source, "source"), (target, "target")))
    return np.linalg.inv(to) @ np.diag(after / before) @ to


def adapt_colors(xyz: Any, source: Any, target: Any, method: str = "bradford") -> Any:
    """Adapt XYZ under one light to another.

    Parameters
    ----------
    xyz : array of shape (..., 3)
        Colours: a point, a list or an image.
    source, target, method
        As for `adaptation_matrix`.

    Returns
    -------
    array of shape (..., 3), float32
        XYZ that looks the same under `target`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        As for `adaptation_matrix`, or if the last axis is not 3 long.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.adapt_colors([[0.95043, 1, 1.0888]], "D65", "D50").round(3)
    array([[0.964, 1.   , 0.825]], dtype=float32)
    """
    return apply_matrix(xyz, adaptation_matrix(source, target, method), "xyz", name="xyz")
