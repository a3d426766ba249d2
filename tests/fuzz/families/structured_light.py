"""Structured light: patterns, their decoding, lines of a laser, and points in space."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    Maker,
    alike,
    image,
    mask,
    maybe,
    number,
    one,
    one_of,
    whole,
)
from tests.fuzz.families.cameras import CAMERA, FIXED

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


SCAN = cvkern.make_scan("gray_code", (12, 16), (12, 16), seed=1)
LENS = cvkern.Camera(np.array([[40, 0, 31.5], [0, 40, 23.5], [0, 0, 1]]), (), (48, 64))
BOARD = cvkern.chessboard_points((3, 4), 0.06)
TILTS = ((0.5, 0, 0.1), (-0.2, 0.5, 0), (0.3, -0.4, 0.2))
AXIS = one("columns", "rows", "none")


def places(draw: Draw) -> Any:
    """Return columns of a projector that the pixels of a camera see, some NaN."""
    if draw.odd(0.2):
        return image(draw)
    found = draw.rng.uniform(0, 16, (12, 16)).astype(np.float32)
    found[draw.rng.random((12, 16)) < 0.1] = np.nan
    return found


def known(draw: Draw) -> Any:
    """Return a mask of the pixels of :func:`places`, of any dtype."""
    if draw.odd(0.1):
        return mask(draw)
    found = draw.rng.integers(0, 2, (12, 16)) * draw.pick([1, 0.5, 256, -1])
    return found.astype(draw.pick(["?", "u1", "i2", "f4", "f8"]))


def lines(draw: Draw) -> Any:
    """Return places of laser lines in some frames, some NaN."""
    if draw.odd(0.2):
        return image(draw)
    found = draw.rng.uniform(0, 48, (int(draw.pick([1, 3])), 64))
    found[draw.rng.random(found.shape) < 0.1] = np.nan
    return found


def decoded(draw: Draw) -> list[Any]:
    """Return what a projector's patterns tell of a few views of a board, some pixels dark."""
    found = []
    for turn in TILTS[: int(draw.pick([0, 1, 3, 3, 3, 3, 3, 3]))]:
        y, x = np.indices(LENS.shape) * 0.3
        columns = (x + 3 * turn[1] * y + draw.rng.normal(0, draw.pick([0, 0, 9]), y.shape)) % 16
        valid = draw.rng.random(y.shape) < draw.pick([1, 0.9, 0.1])
        found.append(cvkern.GrayCode(columns.astype("f4"), (y % 16).astype("f4"), valid))
    return found


def corners(draw: Draw) -> list[np.ndarray]:
    """Return what a camera sees of a board, as often as :func:`decoded` can."""
    views = [cvkern.project_points(BOARD, LENS, turn, (-0.1, -0.1, 0.5)) for turn in TILTS]
    return views if draw.odd(0.7) else views[: int(draw.pick([0, 1, 2]))]


def beams(draw: Draw) -> list[np.ndarray]:
    """Return points of a laser's line in some views, a few of them NaN."""
    found = []
    for _ in range(int(alike(draw).pick([0, 1, 2, 3, 3]))):
        line = np.stack((np.arange(20.0), draw.rng.uniform(0, 64) + np.zeros(20)), axis=1)
        line[draw.rng.random(20) < draw.pick([0, 0.1, 1])] = np.nan
        found.append(line[: draw.pick([20, 20, 0])])
    return found


def turns(draw: Draw) -> Any:
    """Return rotations of a few boards."""
    count = int(alike(draw).pick([0, 1, 2, 3, 3]))
    spins = [cvkern.geometry.cameras.lens.turned(t) for t in draw.rng.normal(0, 0.3, (count, 3))]
    off = draw.rng.normal(0, draw.pick([0, 0, 0, 0.1, 1e9]), (3, 3))
    return np.reshape(spins, (count, 3, 3)) + off


def shifts(draw: Draw) -> Any:
    """Return places of a few boards."""
    count = int(alike(draw).pick([0, 1, 2, 3, 3]))
    found = draw.rng.normal(0, 1, (count, 3)) + np.array([0, 0, 5.0])
    return found * draw.pick([1, 1, 1, 1, 0, 1e-300, 1e300])


def plane(draw: Draw) -> Any:
    """Return a plane, or any four numbers."""
    return draw.pick([(0, 0.6, 0.8, -1.0), (0, 0, 0, 1), draw.rng.normal(size=4), (1, 2)])


CALLS: dict[str, Call] = {
    "gray_code_patterns": Call(
        cvkern.gray_code_patterns, {"shape": size}, {**PATTERNS, "lights": one(False, True)}
    ),
    "phase_shift_patterns": Call(
        cvkern.phase_shift_patterns,
        {"shape": size},
        {
            **PATTERNS,
            "frequencies": FREQUENCIES,
            "steps": STEPS,
            "gamma": one_of(number(0.3, 3), one(np.arange(256) ** 1.5, np.zeros(256))),
        },
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
    "calibrate_projector": Call(
        cvkern.calibrate_projector,
        {
            "object_points": one(BOARD),
            "image_points": corners,
            "decoded": decoded,
            "shape": one(LENS.shape),
            "projector_shape": one((16, 16), (1, 1), (0, 3)),
        },
        {"camera": maybe(one(LENS)), "fixed": FIXED},
    ),
    "fit_laser_plane": Call(
        cvkern.fit_laser_plane,
        {"lines": beams, "camera": CAMERA, "rotations": turns, "translations": shifts},
        {},
    ),
    "make_scan": Call(
        cvkern.make_scan,
        {
            "kind": one("gray_code", "phase_shift", "laser", "none"),
            "shape": one((24, 32), (12, 16), (1, 1), (0, 3)),
            "projector_shape": one((24, 32), (1, 1), (0, 3)),
            "frames": whole(0, 4),
        },
        {
            "noise": number(0, 3),
            "seed": whole(0, 9),
        },
    ),
    "triangulate_columns": Call(
        cvkern.triangulate_columns,
        {"columns": places, "calibration": one(SCAN.calibration)},
        {"valid": maybe(known), "axis": AXIS},
        equal="cpu",  # a GPU ends Newton's method earlier
    ),
    "triangulate_lines": Call(
        cvkern.triangulate_lines,
        {"positions": lines, "camera": CAMERA, "plane": plane},
        {
            "axis": one(0, 1, 2),
            "angles": maybe(one((0, 0.1, 0.2), (0,), (np.nan,))),
            "pivot": maybe(one((0, 0, 1), (1, 2))),
            "spindle": one((0, -1, 0), (0, 0, 0), (1, 2)),
        },
    ),
}
