"""Structured light: patterns, their decoding, lines of a laser."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, image, mask, maybe, number, one

AXES = one(("columns", "rows"), ("columns",), ("rows",), (), ("x",))
FREQUENCIES = one((1, 8, 64), (1,), (1, 4), (8, 1), ())
STEPS = one(3, 4, 5, 2)


def size(draw: Draw) -> Any:
    """Return a projector's height and width."""
    return tuple(int(n) for n in draw.rng.choice([1, 2, 3, 16, 31, 64], 2))


def frames(draw: Draw) -> Any:
    """Return a few images."""
    return image(draw, (int(draw.pick([1, 2, 7])), *draw.shape))


def gray(draw: Draw) -> Any:
    """Return images as a camera sees the patterns of `size`, which is (16, 31) here."""
    found = cvkern.gray_code_patterns((16, 31), lights=draw.odd(0.2)).astype(np.float32)
    found = found * draw.rng.uniform(0.1, 1) + draw.rng.normal(
        0, draw.pick([0, 5, 90]), found.shape
    )
    return found.astype(draw.pick(["f4", "f8"])) if draw.odd(0.7) else frames(draw)


def phases(draw: Draw) -> Any:
    """Return images as a camera sees shifted cosines."""
    found = cvkern.phase_shift_patterns((16, 31)).astype(np.float32)
    found += draw.rng.normal(0, draw.pick([0, 5, 90]), found.shape)
    return found if draw.odd(0.7) else frames(draw)


SIZE = one((16, 31), (16, 31), (16, 31), (64, 64), (1, 1))
PATTERNS: dict[str, Maker] = {"axes": AXES}
CALLS: dict[str, Call] = {
    "gray_code_patterns": Call(
        cvkern.gray_code_patterns, {"shape": size}, {**PATTERNS, "lights": one(False, True)}
    ),
    "phase_shift_patterns": Call(
        cvkern.phase_shift_patterns,
        {"shape": size},
        {**PATTERNS, "frequencies": FREQUENCIES, "steps": STEPS, "gamma": number(0.3, 3)},
    ),
    "decode_gray_code": Call(
        cvkern.decode_gray_code,
        {"images": gray, "shape": SIZE},
        {
            **PATTERNS,
            "white": maybe(image),
            "black": maybe(image),
            "margin": maybe(number(0, 9)),
            "contrast": maybe(number(0, 99)),
        },
    ),
    "decode_phase_shift": Call(
        cvkern.decode_phase_shift,
        {"images": phases, "shape": SIZE},
        {**PATTERNS, "frequencies": FREQUENCIES, "steps": STEPS, "threshold": maybe(number(0, 9))},
    ),
    "detect_laser_lines": Call(
        cvkern.detect_laser_lines,
        {"frames": frames},
        {
            "axis": one(0, 1, 2),
            "method": one("steger", "center_of_mass", "peak", "none"),
            "sigma": number(0.5, 4),
            "threshold": maybe(number(0, 99)),
        },
    ),
    "unwrap_phase": Call(cvkern.unwrap_phase, {"phase": image}, {"mask": maybe(mask)}),
}
