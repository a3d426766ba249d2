"""Filters: images with and without channels, where results go, and filters that are captured."""

from __future__ import annotations

from typing import Any

import cvkern
from tests.fuzz.arguments import (
    BORDER,
    IMAGE,
    MASK,
    Call,
    Maker,
    channels,
    number,
    one,
    pair,
    place,
    several,
    whole,
)

SIGMAS: dict[str, Maker] = {
    "sigma": pair(number(0, 8)),
    "order": pair(whole(0, 3)),
    "truncate": number(0, 6),
}
OUT: dict[str, Maker] = {"out": place}
DEEP: dict[str, Maker] = {"image": channels, "channel_axis": one(-1, 2, 2, 0)}
STACK: dict[str, Maker] = {"image": channels, "batch_axis": one(0, 0, 0, None, 1)}
AXIS: dict[str, Maker] = {"axis": one(None, 0, 1, 2, -1)}


def repeated(image: Any, sigma: Any) -> Any:
    """Capture a chain of calls and repeat it."""
    return cvkern.capture(
        lambda x: cvkern.gradient(cvkern.gaussian(x, sigma), sigma=sigma), image
    )()


CALLS: dict[str, Call] = {
    "capture": Call(repeated, {**IMAGE, "sigma": number(0, 4)}, {}),
    "gaussian": Call(
        cvkern.gaussian,
        IMAGE,
        {
            **BORDER,
            **SIGMAS,
            **OUT,
        },
    ),
    "box": Call(cvkern.box, IMAGE, {**BORDER, **OUT, "radius": pair(whole(0, 30))}),
    "correlate_separable": Call(
        cvkern.correlate_separable,
        {**IMAGE, "taps": several(number(-2, 2), 1, 7)},
        {**BORDER, **OUT},
    ),
    "median": Call(cvkern.median, IMAGE, {**BORDER, **OUT, "radius": whole(0, 16)}),
    "sobel": Call(cvkern.sobel, IMAGE, {**BORDER, **AXIS, **MASK}),
    "sobel_h": Call(cvkern.sobel_h, IMAGE, MASK),
    "sobel_v": Call(cvkern.sobel_v, IMAGE, MASK),
    "scharr": Call(cvkern.scharr, IMAGE, {**BORDER, **AXIS, **MASK}),
    "prewitt": Call(cvkern.prewitt, IMAGE, {**BORDER, **AXIS, **MASK}),
    "laplace": Call(cvkern.laplace, IMAGE, {**BORDER, **MASK, "ksize": one(3, 5)}),
    "laplace of a stack": Call(cvkern.laplace, STACK, BORDER),
    "scharr of a stack": Call(cvkern.scharr, STACK, {**BORDER, **AXIS}),
    "box of a stack": Call(cvkern.box, STACK, {**BORDER, "radius": pair(whole(0, 30))}),
    "correlate_separable of channels": Call(
        cvkern.correlate_separable, {**DEEP, "taps": several(number(-2, 2), 1, 7)}, BORDER
    ),
    "box to integers": Call(
        cvkern.box,
        IMAGE,
        {**BORDER, "radius": pair(whole(0, 30)), "dtype": one("uint8", "uint16", "int8")},
    ),
    "laplace of channels": Call(cvkern.laplace, DEEP, BORDER),
    "threshold_otsu": Call(cvkern.threshold_otsu, IMAGE, {"nbins": whole(0, 300)}),
    "gradient": Call(
        cvkern.gradient,
        IMAGE,
        {**BORDER, "sigma": number(0, 5), "operator": one("gaussian", "sobel", "scharr")},
    ),
    "gaussian of channels": Call(cvkern.gaussian, DEEP, {**BORDER, **SIGMAS}),
    "box of channels": Call(cvkern.box, DEEP, {**BORDER, "radius": pair(whole(0, 30))}),
    "gaussian to integers": Call(
        cvkern.gaussian,
        IMAGE,
        {**BORDER, **SIGMAS, "dtype": one("uint8", "uint16", "float32", None, "int8")},
    ),
    "gaussian of a stack": Call(cvkern.gaussian, STACK, {**BORDER, **SIGMAS}),
    "median of a stack": Call(cvkern.median, STACK, {**BORDER, "radius": whole(0, 16)}),
    "sobel of a stack": Call(cvkern.sobel, STACK, {**BORDER, **AXIS}),
    "gradient of a stack": Call(cvkern.gradient, STACK, {**BORDER, "sigma": number(0, 5)}),
    "gradient of colours": Call(cvkern.gradient, {"image": channels}, BORDER),
    "median of channels": Call(cvkern.median, DEEP, {**BORDER, "radius": whole(0, 16)}),
}
