"""Metamers: different spectra of one colour."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import as_numbers
from cvkern.color.spectra import matching_weights
from cvkern.kernels.codes.color import LAB_LOW, LAB_SHIFT, LAB_SLOPE


def metamer(
    reflectance: Any,
    light: Any = "D65",
    other: Any = "A",
    *,
    wavelengths: Any = None,
    observer: str = "cie1931",
) -> np.ndarray:
    """Return another paint of the same colour under one light, of a far one under another.

    Parameters
    ----------
    reflectance : sequence of N floats
        Reflectances in 0 to 1.
    light : str or sequence of N floats, default 'D65'
        The light under which the two must look the same: a light of `standard_light`, or its power.
    other : str or sequence of N floats, default 'A'
        The light under which they should look different.
    wavelengths : sequence of N floats, optional
        In nanometres; 380 to 780 in steps of 5 when omitted.
    observer : {'cie1931', 'cie1964'}, default 'cie1931'
        Who looks.

    Returns
    -------
    (N,) float64
        Reflectances in 0 to 1, with the X, Y and Z of `reflectance` under `light`, to 1e-9.

    Raises
    ------
    TypeError
        If an array is not of numbers.
    ValueError
        If lengths differ, a reflectance is not in 0 to 1, or a name is unknown.

    See Also
    --------
    metameric_difference : How different two paints look under a light.

    Notes
    -----
    What an observer cannot see under a light is the null space of three sums over wavelengths: any
    spectrum of it may be added while reflectances stay in 0 to 1 [1]_. The extremes under the other
    light, in 26 directions of XYZ, are linear programs; the one that looks most different is
    returned. They are all or nothing at most wavelengths, as extremes of linear programs are.

    References
    ----------
    .. [1] G. Wyszecki, "Evaluation of metameric colors", Journal of the Optical Society of America
       48, 1958.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> grey = np.full(81, 0.5)
    >>> twin = cvkern.metamer(grey)
    >>> cvkern.metameric_difference(grey, twin, "D65") < 1e-3
    True
    """
    from scipy.optimize import linprog

    grid, same = matching_weights(wavelengths, light, observer)
    base = _reflectance(reflectance, "reflectance", len(grid))
    _, seen = matching_weights(grid, other, observer)
    white = seen.sum(axis=0)
    want = base @ same
    best, most = base, -1.0
    for direction in np.ndindex(3, 3, 3):
        goal = seen @ ((np.array(direction) - 1.0) / white)
        if not goal.any():
            continue
        found = linprog(goal, A_eq=same.T, b_eq=want, bounds=(0, 1), method="highs")
        if not found.success:
            continue
        paint = _exact(found.x, same, want)
        off = _difference(base @ seen, paint @ seen, white)
        if off > most:
            best, most = paint, off
    return best


def metameric_difference(
    first: Any,
    second: Any,
    light: Any = "D65",
    *,
    wavelengths: Any = None,
    observer: str = "cie1931",
) -> float:
    """Return how different two paints look under a light, as CIEDE2000.

    Parameters
    ----------
    first, second : sequence of N floats
        Reflectances.
    light, wavelengths, observer
        As for `metamer`.

    Returns
    -------
    float
        The difference in L*a*b* with the light as white.

    Raises
    ------
    TypeError
        If an array is not of numbers.
    ValueError
        If lengths differ, a reflectance is not in 0 to 1, or a name is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> round(cvkern.metameric_difference(np.full(81, 0.5), np.full(81, 0.4), "A"), 2)
    4.94
    """
    grid, seen = matching_weights(wavelengths, light, observer)
    one = _reflectance(first, "first", len(grid)) @ seen
    other = _reflectance(second, "second", len(grid)) @ seen
    return _difference(one, other, seen.sum(axis=0))


def _reflectance(values: Any, name: str, count: int) -> np.ndarray:
    values = as_numbers(values, name)
    if values.shape != (count,):
        raise ValueError(f"{name} must have shape {(count,)}, got {values.shape}")
    if not ((values >= 0) & (values <= 1)).all():
        raise ValueError(f"{name} must be in [0, 1], got values that are not")
    return values


def _exact(paint: np.ndarray, same: np.ndarray, want: np.ndarray) -> np.ndarray:
    """Remove the error of the solver's tolerance, at wavelengths that are not at their bounds."""
    paint = paint.clip(0, 1)
    for _ in range(3):
        free = (paint > 1e-6) & (paint < 1 - 1e-6)
        if free.sum() < 3:
            free = np.ones(len(paint), bool)
        change = np.linalg.lstsq(same[free].T, want - paint @ same, rcond=None)[0]
        paint[free] = (paint[free] + change).clip(0, 1)
    return paint


def _difference(first: np.ndarray, second: np.ndarray, white: np.ndarray) -> float:
    from cvkern._runtime import use
    from cvkern.color.differences import deltaE_ciede2000

    def lab(xyz: np.ndarray) -> np.ndarray:
        t = xyz / white
        f = np.where(t > LAB_LOW, np.cbrt(t), LAB_SLOPE * t + LAB_SHIFT)
        return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])

    with use(device="cpu"):
        return float(deltaE_ciede2000(lab(first), lab(second)))
