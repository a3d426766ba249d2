"""Observers, lights, paints and metamers."""

from typing import Any

import numpy as np
import pytest

import cvkern
from tests.truth import truth


def test_whites(backend):
    """White points of CIE 15, table T.3, but for the range of wavelengths."""
    for light, want in (("D65", (0.95043, 1, 1.0888)), ("A", (1.0985, 1, 0.35585)),
                        ("D50", (0.96421, 1, 0.82512)), ("E", (1, 1, 1))):  # fmt: skip
        got = cvkern.spectrum_to_xyz(np.ones(81), light=light)
        np.testing.assert_allclose(got, want, atol=1e-4)
    got = cvkern.spectrum_to_xyz(np.ones(81), observer="cie1964")
    np.testing.assert_allclose(got, (0.9481, 1, 1.0732), atol=1e-4)
    cones = cvkern.spectrum_to_xyz(np.ones(81), observer="stockman_sharpe")
    np.testing.assert_array_equal(cones, 1)


def test_d65_from_tables_of_others(backend):
    folder = truth("light_colour") / "spectra"
    lights, table = (
        np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        for name in ("illuminants", "cie1931_2deg_cmfs")
    )
    names: Any = table.dtype.names
    matching = np.stack([table[name] for name in names[1:]], 1)
    want = lights["D65"] @ matching / (lights["D65"] @ matching[:, 1])
    np.testing.assert_allclose(cvkern.spectrum_to_xyz(np.ones(81)), want, atol=1e-6)


@pytest.mark.parametrize("shape", [(31,), (5, 31), (4, 6, 31)])
def test_sums(backend, shape):
    grid = np.linspace(400, 700, 31)
    spectra = np.random.default_rng(0).random(shape).astype(np.float32)
    observer = cvkern.standard_observer("cie1931", 1)
    at = np.searchsorted(observer.wavelengths, grid)
    power = cvkern.standard_light("A", grid).values
    weights = observer.values[at] * power[:, None]
    want = spectra.astype(float) @ weights / weights[:, 1].sum()
    got = cvkern.spectrum_to_xyz(spectra, grid, light="A")
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, want, rtol=2e-7)
    got = cvkern.spectrum_to_xyz(spectra, grid, light=None)
    np.testing.assert_allclose(got, spectra @ observer.values[at] * 10 * 683.002, rtol=1e-6)


def test_the_chart_is_grey_where_it_is(backend):
    chart = cvkern.color_chart(np.arange(380.0, 781.0, 5.0))
    lab = cvkern.convert_color(cvkern.spectrum_to_xyz(chart.values.T), "xyz", "lab")
    assert (np.hypot(lab[18:, 1], lab[18:, 2]) < 3.2).all()  # the white patch is a little yellow
    assert (np.diff(lab[18:, 0]) < 0).all()


def test_unequal_steps_weigh_what_they_span(backend):
    """Steps of 1, 2 and 4 nm: the sums near those of 1 nm throughout."""
    fine = np.arange(380.0, 781)
    uneven = np.concatenate((np.arange(380, 480), np.arange(480, 600, 2), np.arange(600, 781, 4.0)))
    want, got = (
        cvkern.spectrum_to_xyz(0.5 + 0.4 * np.sin(grid / 40), grid, light="A")
        for grid in (fine, uneven)
    )
    np.testing.assert_allclose(got, want, rtol=3e-4)  # measured: 9e-5


def test_metamers_are_sought_in_all_directions():
    """A grey's farthest metamer lies where luminance rises: 22.5; without these 21.5."""
    grey = np.full(81, 0.5)
    assert cvkern.metameric_difference(grey, cvkern.metamer(grey), "A") > 22.4


def test_metamers_match_under_one_light_only():
    grid, chart = np.arange(380.0, 781.0, 5.0), cvkern.color_chart(np.arange(380.0, 781.0, 5.0))
    light = cvkern.standard_light("D65", grid).values
    weights = cvkern.standard_observer().values * light[:, None]
    weights /= weights[:, 1].sum()
    for paint in chart.values.T[[0, 5, 14, 21]]:
        twin = cvkern.metamer(paint)
        assert twin.min() >= 0
        assert twin.max() <= 1
        assert np.abs((paint - twin) @ weights).max() < 1e-9
        assert cvkern.metameric_difference(paint, twin) < 1e-3
        assert cvkern.metameric_difference(paint, twin, "A") > 7.2
        assert cvkern.metameric_difference(paint, twin, "FL11") > 6.4


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("spectra must have 81 values, one a wavelength, got 3",
         lambda: cvkern.spectrum_to_xyz(np.eye(3))),
        ("wavelengths must rise, got ones that do not",
         lambda: cvkern.spectrum_to_xyz(np.eye(3), [400, 400, 500])),
        ("light must have shape (3,), got (2,)",
         lambda: cvkern.spectrum_to_xyz(np.eye(3), [400, 500, 600], light=[1, 2])),
        ("light must be seen by the observer, got one of no power",
         lambda: cvkern.spectrum_to_xyz(np.eye(3), [400, 500, 600], light=[0, 0, 0])),
        ("interval must be 5 or 1, got 2", lambda: cvkern.standard_observer(interval=2)),
        ("reflectance must be in [0, 1], got values that are not",
         lambda: cvkern.metamer(np.full(81, 2.0))),
        ("reflectance must have shape (81,), got (4,)", lambda: cvkern.metamer(np.ones(4))),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, message, call):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        call()
    assert str(info.value) == message
