"""A scene of solids, rendered by the library itself."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_flag, check_integer
from cvkern._runtime import refuse_capture, runtime
from cvkern.kernels.codes.radiance import Pattern, Shape, Solids
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.pinhole import cameras, look_at
from cvkern.radiance.rendering import on_device
from cvkern.radiance.scenes.photographs import Bounds, Scene

__all__ = ["make_scene"]

SUN = (0.45, -0.35, 0.82)
BOUNDS = Bounds((0.0, 0.0, 0.3), 1.05, False)
WORLD = Bounds((0.0, 0.0, 0.0), 1.0, False)
BALL = (0.0, 0.0, 0.25, 1.16)  # middle and radius of a ball around the solids
TARGET = (0.0, 0.0, 0.22)
DISTANCE = 3.7
SPECKLES = 0.9  # strength of the speckles, from 0 to 1
FOCAL = 1.5  # focal length in image sides
LOW, HIGH = 8.0, 62.0  # degrees above the ground
GOLDEN = math.pi * (3 - math.sqrt(5))


class Solid(NamedTuple):
    """A solid and its paint: lengths in units of the world, angles in degrees."""

    kind: Shape
    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    color: tuple[float, float, float]
    rounding: float = 0.0
    turn: float = 0.0  # rotation about z
    tilt: float = 0.0  # rotation about its own x axis, applied before the turn
    gloss: float = 0.6
    pattern: Pattern = Pattern.PLAIN
    second: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0


SOLIDS = (
    Solid(Shape.CYLINDER, (0, 0, -0.08), (1.0, 0.08, 0), (0.80, 0.74, 0.66), 0.03, 20, 0, 0.25,
          Pattern.CHECKS, (0.42, 0.35, 0.31), 3.0),
    Solid(Shape.ELLIPSOID, (0.36, -0.22, 0.34), (0.34, 0.34, 0.34), (0.80, 0.09, 0.07), gloss=1.0),
    Solid(Shape.BOX, (-0.43, -0.30, 0.28), (0.22, 0.22, 0.28), (0.05, 0.45, 0.46), 0.05, 28),
    Solid(Shape.ELLIPSOID, (-0.43, -0.30, 0.70), (0.14, 0.14, 0.14), (0.95, 0.80, 0.55)),
    Solid(Shape.TORUS, (-0.16, 0.46, 0.36), (0.27, 0.09, 0), (0.95, 0.60, 0.10), 0, -35, 90, 0.9),
    Solid(Shape.CYLINDER, (0.50, 0.42, 0.24), (0.17, 0.24, 0), (0.28, 0.16, 0.55), 0.03, 0, 0, 0.6,
          Pattern.STRIPES, (0.85, 0.82, 0.90), 9.4),
    Solid(Shape.ELLIPSOID, (-0.02, -0.68, 0.10), (0.17, 0.13, 0.10), (0.20, 0.50, 0.14), 0, 30),
)  # fmt: skip
# The room of the layout 'forward': a floor, and a wall behind the solids.
ROOM = (
    Solid(Shape.BOX, (0, 0, -0.26), (9, 9, 0.1), (0.62, 0.60, 0.58), gloss=0.1,
          pattern=Pattern.CHECKS, second=(0.38, 0.40, 0.44), scale=2.2),
    Solid(Shape.BOX, (0, 1.9, 0), (9, 9, 0.1), (0.75, 0.68, 0.52), tilt=90, gloss=0.1,
          pattern=Pattern.CHECKS, second=(0.55, 0.62, 0.60), scale=1.3),
)  # fmt: skip
ROOM_BALL = (0.0, 0.0, 0.25, 20.0)
ROOM_BOUNDS = Bounds((0.0, 0.0, 0.5), 2.2, False)
ASIDE = 0.7  # radius of the disc of cameras of the layout 'forward'
ROOM_DEPTHS = 1.8, 9.0  # distances of everything that these cameras see


def make_scene(
    *,
    train: int = 40,
    test: int = 8,
    size: int = 100,
    samples: int = 2,
    layout: str = "around",
    texture: bool = False,
) -> Scene:
    """Render photographs of a few solids on a plinth, from all sides and from above.

    The solids have shadows, patterns, and glossy paint, which looks different from every side.

    Parameters
    ----------
    layout : {'around', 'forward'}, default 'around'
        Where the cameras are: on a spiral around the solids, from low to high, or all on one side,
        on a disc, as for a :class:`PlanesField`. Then the solids stand in a room, whose floor and
        wall fill the photographs.
    train, test : int, default 40 and 8
        Number of training views, at least 1, and of held-out views.
    size : int, default 100
        Rows and columns of an image, at most 4096.
    samples : int, default 2
        A pixel is the mean of `samples` x `samples` rays.
    texture : bool, default False
        Speckle all solids, so that keypoints are found on them (:func:`cvkern.reconstruct`).

    Returns
    -------
    Scene
        RGBA images, with a transparent background if the cameras are around the solids, and
        depths. The world's z axis points up; the plinth has a radius of 1.

    Raises
    ------
    TypeError
        If a number is not an integer, or `texture` is not a bool.
    ValueError
        If a number is out of its range, or `layout` is unknown.

    Examples
    --------
    >>> from cvkern.radiance import make_scene
    >>> make_scene(train=2, test=1, size=24).images.shape
    (3, 24, 24, 4)
    """
    refuse_capture("make_scene")
    train = check_integer(train, "train", 1, 10000)
    test = check_integer(test, "test", 0, 10000)
    size = check_integer(size, "size", 1, 4096)
    samples = check_integer(samples, "samples", 1, 8)
    check_choice(layout, ("around", "forward"), "layout")
    forward = layout == "forward"
    speckles = SPECKLES if check_flag(texture, "texture") else 0.0
    count, fine = train + test, size * samples
    marks = np.zeros(count, bool)
    if test:
        marks[np.floor((np.arange(test) + 0.5) * count / test).astype(int)] = True
    middle = 0.5 * (fine - 1)
    lens = [FOCAL * fine, FOCAL * fine, middle, middle]
    eyes = _eyes_in_front(count) if forward else _eyes(count)
    views = cameras(look_at(eyes, TARGET), lens, fine, fine)
    rt = runtime()
    lens = on_device(rt, Frame(WORLD, 0.0, 0.0), views)
    *solids, around, sun = (rt.constant(a) for a in _tables(forward, speckles))
    origins, directions = (rt.zeros((fine * fine, 3)) for _ in range(2))
    seen, depth = rt.zeros((fine * fine, 4)), rt.zeros((fine * fine,))
    images = np.empty((count, fine, fine, 4), np.uint8)
    depths = np.empty((count, fine, fine), np.float32)
    for view in range(count):
        rt.radiance.pinhole.view_rays(lens, view, 0, origins, directions)
        rt.radiance.scenes.solids.trace(
            origins, directions, Solids(*solids), around, sun, seen, depth
        )
        images[view] = np.round(255 * rt.to_numpy(seen)).reshape(fine, fine, 4)
        depths[view] = rt.to_numpy(depth).reshape(fine, fine)
    depths[depths == 0] = np.nan
    reach = BALL[3] + abs(TARGET[2] - BALL[2])
    bounds, span = BOUNDS, (DISTANCE - reach, DISTANCE + reach)
    if forward:
        bounds, span = ROOM_BOUNDS, ROOM_DEPTHS
    scene = Scene(images, views, marks, bounds, *span, depths)
    return scene.resized(samples)


def _eyes(count: int) -> np.ndarray:
    """Return positions on a spiral from low to high, evenly spread over that part of the sphere."""
    low, high = (math.sin(math.radians(angle)) for angle in (LOW, HIGH))
    height = low + (high - low) * (np.arange(count) + 0.5) / count
    flat, turn = np.sqrt(1 - height**2), GOLDEN * np.arange(count)
    way = np.stack((flat * np.cos(turn), flat * np.sin(turn), height), axis=1)
    return np.array(TARGET) + DISTANCE * way


def _eyes_in_front(count: int) -> np.ndarray:
    """Return positions on a disc in front of the solids, a little above them, evenly spread."""
    reach = ASIDE * np.sqrt((np.arange(count) + 0.5) / count)
    turn = GOLDEN * np.arange(count)
    rise = math.radians(18.0)
    ahead = np.array([0.0, -math.cos(rise), math.sin(rise)])
    up = np.array([0.0, math.sin(rise), math.cos(rise)])
    right = np.array([1.0, 0.0, 0.0])
    across = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * up
    return np.array(TARGET) + DISTANCE * ahead + reach[:, None] * across


def _tables(forward: bool, speckles: float) -> tuple[np.ndarray, ...]:
    """Return the solids as tables for kernels."""
    solids = SOLIDS + ROOM if forward else SOLIDS
    kinds = np.array([(s.kind, s.pattern) for s in solids], np.int32)
    placements = np.empty((len(solids), 12), np.float32)
    for row, solid in zip(placements, solids, strict=True):
        turn, tilt = math.radians(solid.turn), math.radians(solid.tilt)
        about_z = [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0],
                   [0, 0, 1]]  # fmt: skip
        about_x = [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)],
                   [0, math.sin(tilt), math.cos(tilt)]]  # fmt: skip
        row[:9] = (np.array(about_z) @ np.array(about_x)).T.ravel()
        row[9:] = solid.middle
    sizes = np.array([(*s.size, s.rounding) for s in solids], np.float32)
    paints = np.array(
        [(*s.color, *s.second, s.gloss, s.scale, speckles) for s in solids], np.float32
    )
    sun = np.array(SUN, np.float32) / np.float32(np.linalg.norm(SUN))
    return (
        kinds,
        placements,
        sizes,
        paints,
        np.array(ROOM_BALL if forward else BALL, np.float32),
        sun,
    )
