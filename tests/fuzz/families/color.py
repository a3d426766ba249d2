"""Colour: spaces, spectra, illuminants."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, image, mask, maybe, number, one, one_of

LIGHTS = one("D65", "D50", "A", "E", "F2", "none", (0.95, 1.0, 1.09), (0, 0, 0), (1, 2))
OBSERVER = one("cie1931", "cie1964", "none")
SPACES = one("srgb", "rgb", "xyz", "lms", "lab", "lch", "hsv")
METHODS = one("bradford", "von_kries", "cat02", "none")
VISIBLE = np.arange(380, 781, 5.0)


def three(draw: Draw) -> Any:
    """Return an image with three channels."""
    return image(draw, (*draw.shape, 3))


def spectra(draw: Draw) -> Any:
    """Return reflectances in steps of 5 nm, or any array."""
    if draw.odd(0.1):
        return image(draw)
    return draw.rng.random((*((3,) if draw.odd(0.3) else ()), draw.pick([81, 81, 81, 80])))


WAVES = maybe(one(VISIBLE, VISIBLE[::-1], np.arange(400, 500, 10.0), [500], []))
SEEN: dict[str, Maker] = {"wavelengths": WAVES, "observer": OBSERVER}
DEPTH: dict[str, Maker] = {"dtype": one("float32", "uint8", "float64")}
CALLS: dict[str, Call] = {
    "adapt_colors": Call(
        cvkern.adapt_colors,
        {"xyz": three, "source": LIGHTS, "target": LIGHTS},
        {"method": METHODS},
        equal=False,
    ),
    "adaptation_matrix": Call(
        cvkern.adaptation_matrix, {"source": LIGHTS, "target": LIGHTS}, {"method": METHODS}
    ),
    "color_chart": Call(cvkern.color_chart, {}, {"wavelengths": WAVES}),
    "convert_color": Call(
        cvkern.convert_color,
        {"image": three, "source": SPACES, "target": SPACES},
        {
            "adapt": maybe(one(("A", "D65"), ["D50", (0.9, 1, 1.1)], "A", ("A",), ("A", "none"))),
            "white": maybe(LIGHTS),
            "dtype": one("float32", "uint8", "float64", np.uint16),
        },
        equal=False,
    ),
    "deltaE_ciede2000": Call(
        cvkern.deltaE_ciede2000,
        {"lab1": three, "lab2": three},
        {"kL": number(0, 3), "kC": number(0.5, 2), "kH": number(-1, 2)},
        equal=False,
    ),
    "equalize_adapthist": Call(
        cvkern.equalize_adapthist,
        {"image": one_of(image, three)},
        {
            "kernel_size": maybe(one(1, 4, (8, 3), 200, 0)),
            "clip_limit": number(0, 1),
            "nbins": one(256, 2, 1, 65536, 2**40),
            **DEPTH,
        },
    ),
    "equalize_hist": Call(
        cvkern.equalize_hist,
        {"image": one_of(image, three)},
        {"nbins": one(256, 2, 1, 65536, 0), **DEPTH},
    ),
    "illusion": Call(
        cvkern.illusion,
        {"kind": one("simultaneous_contrast", "checker_shadow", "mach_bands", "none")},
        {"side": one(64, 65, 63, 2**40)},
    ),
    "lateral_inhibition": Call(
        cvkern.lateral_inhibition,
        {"image": image},
        {"center": number(0, 3), "surround": number(0.5, 20), "weight": number(0, 1)},
        equal=False,
    ),
    "retinex": Call(
        cvkern.retinex,
        {"image": one_of(image, three)},
        {
            "sigma": one(5, (1, 8), (), (15.0, 80.0, 250.0), -1),
            "low": number(0.001, 0.5),
            "method": one("surroundings", "gradients", "none"),
            "threshold": number(-0.1, 0.5),
        },
        equal=False,
    ),
    "estimate_illuminant": Call(
        cvkern.estimate_illuminant,
        {"image": three},
        {
            "method": one(
                "consensus",
                "grey_world",
                "white_patch",
                "grey_edge",
                "bright_and_dark",
                "grayness_index",
                "none",
            ),
            "mask": maybe(mask),
            "black": number(0, 64),
            "white": maybe(number(0.1, 255)),
        },
    ),
    "metamer": Call(
        cvkern.metamer, {"reflectance": spectra}, {"light": LIGHTS, "other": LIGHTS, **SEEN}
    ),
    "metameric_difference": Call(
        cvkern.metameric_difference,
        {"first": spectra, "second": spectra},
        {"light": LIGHTS, **SEEN},
        equal=False,
    ),
    "spectrum_to_xyz": Call(
        cvkern.spectrum_to_xyz, {"spectra": spectra}, {"light": LIGHTS, **SEEN}, equal=False
    ),
    "standard_light": Call(cvkern.standard_light, {}, {"name": LIGHTS, "wavelengths": WAVES}),
    "standard_observer": Call(
        cvkern.standard_observer, {}, {"name": OBSERVER, "interval": one(1, 5, 0, 7)}
    ),
    "white_balance": Call(
        cvkern.white_balance,
        {"image": three, "illuminant": one_of(LIGHTS, lambda draw: draw.rng.random(3))},
        {},
        equal=False,
    ),
}
