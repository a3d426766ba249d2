"""Spectra of light and paint, and the colours that observers see in them."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_numbers, check_choice, check_image, check_integer
from cvkern._runtime import runtime

MOST_WHITE = 1e12  # parts of a white point are within it and its inverse
DATA = Path(__file__).parent / "data"
OBSERVERS = {"cie1931": slice(0, 3), "cie1964": slice(3, 6), "stockman_sharpe": slice(6, 9)}
LIGHTS = ("A", "C", "D50", "D55", "D65", "D75", "E", "FL2", "FL7", "FL11")
EFFICACY = 683.002  # lumens a watt at 555 nm


class Spectrum(NamedTuple):
    """Values at wavelengths."""

    wavelengths: np.ndarray
    """In nanometres, (N,) float64, rising."""
    values: np.ndarray
    """One value or several at each wavelength, (N,) or (N, C) float64."""


def standard_observer(name: str = "cie1931", interval: int = 5) -> Spectrum:
    """Return colour-matching functions, or cone fundamentals.

    Parameters
    ----------
    name : {'cie1931', 'cie1964', 'stockman_sharpe'}, default 'cie1931'
        The CIE's standard observer of 2 or of 10 degrees, or the cones' fundamentals (2 degrees).
    interval : {5, 1}, default 5
        Nanometres between wavelengths.

    Returns
    -------
    Spectrum
        From 380 to 780 nm at 5 nm, from 360 to 830 nm at 1 nm; three values at each: x, y and z, or
        L, M and S, each with a maximum of 1.

    Raises
    ------
    TypeError
        If the interval is no integer.
    ValueError
        If the name or the interval is not one of those above.

    Examples
    --------
    >>> import cvkern
    >>> observer = cvkern.standard_observer()
    >>> observer.wavelengths[observer.values[:, 1].argmax()]
    np.float64(555.0)
    """
    check_choice(name, tuple(OBSERVERS), "name")
    table = _table("observers")
    interval = check_integer(interval, "interval", 1, 5)
    if interval not in (1, 5):
        raise ValueError(f"interval must be 5 or 1, got {interval!r}")
    if interval == 5:
        table = table[(table[:, 0] % 5 == 0) & (table[:, 0] >= 380) & (table[:, 0] <= 780)]
    return Spectrum(table[:, 0].copy(), table[:, 1:][:, OBSERVERS[name]].copy())


def standard_light(name: str = "D65", wavelengths: Any = None) -> Spectrum:
    """Return the relative spectral power of a light of the CIE.

    Parameters
    ----------
    name : {'A', 'C', 'D50', 'D55', 'D65', 'D75', 'E', 'FL2', 'FL7', 'FL11'}, default 'D65'
        Which: incandescent, daylights, equal energy, fluorescent lamps.
    wavelengths : sequence of float, optional
        Where, in nanometres; 380 to 780 in steps of 5 when omitted. Between the tabled ones, which
        are 5 nm apart, values are interpolated linearly, and beyond them they are 0.

    Returns
    -------
    Spectrum
        Power at each wavelength; daylights and A are 100 at 560 nm.

    Raises
    ------
    TypeError
        If `wavelengths` are not numbers.
    ValueError
        If the name is unknown, or wavelengths do not rise.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.standard_light("A", [560]).values
    array([100.])
    """
    check_choice(name, LIGHTS, "name")
    table = _table("lights")
    grid = _grid(wavelengths)
    values = np.interp(grid, table[:, 0], table[:, 1 + LIGHTS.index(name)], left=0, right=0)
    return Spectrum(grid, values)


def color_chart(wavelengths: Any = None) -> Spectrum:
    """Return the reflectances of the 24 patches of a ColorChecker.

    Parameters
    ----------
    wavelengths : sequence of float, optional
        Where, in nanometres; 380 to 730 in steps of 10, as measured, when omitted. Between those
        values are interpolated linearly, beyond them the last one holds.

    Returns
    -------
    Spectrum
        (N,) wavelengths and (N, 24) reflectances, row by row of the chart from dark skin to black.

    Raises
    ------
    TypeError
        If `wavelengths` are not numbers.
    ValueError
        If wavelengths do not rise.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.color_chart().values.shape
    (36, 24)
    """
    table = _table("chart")
    if wavelengths is None:
        return Spectrum(table[:, 0].copy(), table[:, 1:].copy())
    grid = _grid(wavelengths)
    columns = [np.interp(grid, table[:, 0], column) for column in table[:, 1:].T]
    return Spectrum(grid, np.stack(columns, axis=1))


def spectrum_to_xyz(
    spectra: Any,
    wavelengths: Any = None,
    *,
    light: Any = "D65",
    observer: str = "cie1931",
) -> Any:
    """Integrate spectra to the colours that an observer sees.

    Parameters
    ----------
    spectra : array of shape (..., N)
        Reflectances, or the power of lights: points (N,), lists (M, N) or images (H, W, N).
    wavelengths : sequence of N floats, optional
        Their wavelengths in nanometres, rising; 380 to 780 in steps of 5 when omitted.
    light : str, array of shape (N,) or None, default 'D65'
        What falls on reflectances: a light of `standard_light`, or its power at each wavelength.
        None where `spectra` are lights themselves.
    observer : {'cie1931', 'cie1964', 'stockman_sharpe'}, default 'cie1931'
        Who looks.

    Returns
    -------
    array of shape (..., 3), float32
        X, Y and Z with Y = 1 for the perfect white under the light; for cones L, M and S with 1 for
        that white. Without a light, Y in lumens for power in watts a nanometre, and for cones the
        integrals. Sums are in float64.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If the lengths differ, wavelengths do not rise, the light is dark, or a name is unknown.

    Notes
    -----
    Sums over the given wavelengths, each times the half distance to its neighbours on both sides;
    the observer's table of 1 nm is interpolated linearly.

    References
    ----------
    .. [1] CIE 15:2018, "Colorimetry", section 7.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.spectrum_to_xyz(np.ones(81)).round(4)  # perfect white, by daylight
    array([0.9504, 1.    , 1.0888], dtype=float32)
    """
    spectra = check_image(spectra, ndim=(1, 2, 3), name="spectra")
    grid, weights = matching_weights(wavelengths, light, observer)
    if spectra.shape[-1] != len(grid):
        raise ValueError(
            f"spectra must have {len(grid)} values, one a wavelength, got {spectra.shape[-1]}"
        )
    rt = runtime(spectra)
    shape = tuple(spectra.shape[:-1])
    count = int(np.prod(shape))
    result = rt.empty((*shape, 3))
    rt.color.spectra.project(
        rt.adopt(spectra, np.float32, (count, len(grid))),
        rt.constant(np.ascontiguousarray(weights)),
        rt.adopt(result, np.float32, (count, 3)),
    )
    return rt.release(result)


def matching_weights(wavelengths: Any, light: Any, observer: str) -> tuple[np.ndarray, np.ndarray]:
    """Return wavelengths (N,), and the weights of the values there, (N, 3)."""
    check_choice(observer, tuple(OBSERVERS), "observer")
    grid = _grid(wavelengths)
    table = _table("observers")
    columns = table[:, 1:][:, OBSERVERS[observer]].T
    matching = np.stack([np.interp(grid, table[:, 0], c, left=0, right=0) for c in columns], 1)
    steps = np.gradient(grid) if len(grid) > 1 else np.ones(1)
    cones = observer == "stockman_sharpe"
    if light is None:
        return grid, matching * steps[:, None] * (1.0 if cones else EFFICACY)
    power = light_power(light, grid)
    weights = matching * (power * steps)[:, None]
    whole = weights.sum(axis=0)
    if not (whole > 0).all():
        raise ValueError("light must be seen by the observer, got one of no power")
    return grid, weights / (whole if cones else whole[1])


def light_power(light: Any, grid: np.ndarray) -> np.ndarray:
    """Return the power of a light, by name or by values, at wavelengths."""
    if isinstance(light, str):
        check_choice(light, LIGHTS, "light")
        return standard_light(light, grid).values
    power = as_numbers(light, "light")
    if power.shape != grid.shape:
        raise ValueError(f"light must have shape {grid.shape}, got {power.shape}")
    return power


def white_point(light: Any, name: str) -> np.ndarray:
    """Return the XYZ of a light for the observer of 2 degrees, or those given."""
    if isinstance(light, str):
        check_choice(light, LIGHTS, name)
        return matching_weights(None, light, "cie1931")[1].sum(axis=0)
    white = as_numbers(light, name)
    if white.shape != (3,) or not (np.isfinite(white).all() and (white > 0).all()):
        raise ValueError(f"{name} must be three positive numbers, got {np.asarray(light).tolist()}")
    if white.min() < 1 / MOST_WHITE or white.max() > MOST_WHITE:
        rule = f"in [{1 / MOST_WHITE:g}, {MOST_WHITE:g}]"
        raise ValueError(f"{name} must be three numbers {rule}, got {white.tolist()}")
    return white


def _grid(wavelengths: Any) -> np.ndarray:
    if wavelengths is None:
        return np.arange(380.0, 781.0, 5.0)
    grid = np.atleast_1d(as_numbers(wavelengths, "wavelengths"))
    if grid.ndim != 1 or len(grid) == 0 or not (np.diff(grid) > 0).all():
        raise ValueError("wavelengths must rise, got ones that do not")
    return grid


@lru_cache
def _table(name: str) -> np.ndarray:
    return np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=1)
