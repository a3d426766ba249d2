"""A rendered scanner: photographs of an object under patterns, with the true geometry."""

from __future__ import annotations

import importlib
import math
from typing import NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_integer, check_number, check_sides
from cvkern.geometry.cameras.lens import Camera, rays_of, seen, turned
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration
from cvkern.structured_light.patterns import gray_code_patterns, phase_shift_patterns

KINDS = ("gray_code", "phase_shift", "laser")
# A figure of balls on a turn-table: x right, y down, z ahead of the camera, and the radius.
BALLS = np.array(
    [[0.0, 0.55, 6.0, 0.95], [0.0, -0.75, 6.0, 0.62], [-0.5, -1.25, 6.1, 0.3],
     [0.5, -1.25, 6.1, 0.3], [0.1, -0.65, 5.35, 0.16], [0.75, 0.2, 5.5, 0.35]]
)  # fmt: skip
PIVOT = np.array([0.0, 0.0, 6.0])
SPINDLE = np.array([0.0, -1.0, 0.0])
WALL = np.array([0.12, -0.05, 1.0, 7.6])  # a X + b Y + c Z = d
BASELINE = 1.6  # distance of the projector, or the laser, to the left of the camera
LENS = (-0.12, 0.03, 0.0, 0.0)
AMBIENT, BRIGHTNESS = 14.0, 190.0
WIDTH = 0.012  # standard deviation of the laser's sheet, in the unit of the balls


class Scan(NamedTuple):
    """Frames of a rendered scanner, and the true geometry."""

    frames: np.ndarray
    """(K, H, W) uint8: one for each pattern, or for each turn of the table."""
    white: np.ndarray
    """The object in full light, (H, W) uint8."""
    black: np.ndarray
    """The object in the light of the room alone, (H, W) uint8."""
    calibration: StereoCalibration
    """The camera as `left`, the projector as `right`."""
    points: np.ndarray
    """The point (X, Y, Z) that each pixel sees, in camera axes, (H, W, 3) float64; NaN where there
    is none. For 'laser' the object has not turned."""
    lit: np.ndarray
    """Whether the projector lights that point, (H, W) bool."""
    plane: np.ndarray
    """Plane of the laser, a X + b Y + c Z = d, (4,) float64."""
    angles: np.ndarray
    """Angle of the table in each frame of 'laser', (K,) float64, radians."""
    pivot: np.ndarray
    """A point on the axis of the table, (3,) float64."""
    spindle: np.ndarray
    """Direction of that axis, (3,) float64."""
    balls: np.ndarray
    """The balls of the object, (M, 4) float64: centre and radius."""


def make_scan(
    kind: str = "gray_code",
    shape: tuple[int, int] = (240, 320),
    projector_shape: tuple[int, int] = (240, 320),
    *,
    frames: int = 60,
    noise: float = 1.0,
    seed: int = 0,
) -> Scan:
    """Render a figure of balls in front of a scanner.

    Parameters
    ----------
    kind : {'gray_code', 'phase_shift', 'laser'}, default 'gray_code'
        The first two project the patterns of :func:`gray_code_patterns` or
        :func:`phase_shift_patterns`, with its defaults, on the figure and a wall behind it. 'laser'
        projects an upright sheet of light on the figure while a turn-table turns it once.
    shape : (int, int), default (240, 320)
        Rows and columns of the camera.
    projector_shape : (int, int), default (240, 320)
        Rows and columns of the projector.
    frames : int, default 60
        Number of positions of the table, for 'laser'.
    noise : float, default 1.0
        Standard deviation of the noise, in values of 0 to 255.
    seed : int, default 0
        Seed of the noise.

    Returns
    -------
    Scan
        Named tuple of `frames`, `white`, `black`, `calibration`, `points`, `lit`, `plane`,
        `angles`, `pivot`, `spindle` and `balls`.

    Raises
    ------
    TypeError
        If a number is not one.
    ValueError
        If `kind` is unknown, or a number is out of its range.

    Examples
    --------
    >>> import cvkern
    >>> scan = cvkern.make_scan("gray_code", (48, 64), (40, 60))
    >>> scan.frames.shape
    (24, 48, 64)
    """
    check_choice(kind, KINDS, "kind")
    height, width = check_sides(shape, "shape")
    projector = check_sides(projector_shape, "projector_shape")
    frames = check_integer(frames, "frames", 1, 10**5)
    noise = abs(check_number(noise, "noise", low=0))  # the generator refuses -0.0
    rng = np.random.default_rng(check_integer(seed, "seed", 0, 2**63 - 1))
    calibration = _stand((height, width), projector)
    rays = _rays(calibration.left)
    source = -calibration.rotation.T @ calibration.translation
    plane = _sheet(source)

    def photograph(light: np.ndarray) -> np.ndarray:
        dark = light + rng.normal(0, noise, light.shape)
        return dark.clip(0, 255).round().astype(np.uint8)

    wall = None if kind == "laser" else WALL
    points, normals = _meet(rays, BALLS, wall)
    places = _thrown(points, calibration)
    inside = (places > -0.5) & (places < np.array(projector) - 0.5)
    lit = _lit(points, source, BALLS, wall) & inside.all(axis=-1)
    shade = _shade(points, normals, source) * np.isfinite(points[..., 0])
    gleam = np.where(lit, shade, 0)
    white, black = photograph(AMBIENT * shade + BRIGHTNESS * gleam), photograph(AMBIENT * shade)
    angles = np.zeros(0)
    if kind == "laser":
        angles = 2 * math.pi * np.arange(frames) / frames
        stack = np.stack([photograph(_line(rays, angle, source, plane)) for angle in angles])
    else:
        make = gray_code_patterns if kind == "gray_code" else phase_shift_patterns
        ndimage = importlib.import_module("scipy.ndimage")
        thrown = np.where(np.isfinite(places), places, -9).reshape(-1, 2).T
        stack = np.stack([
            photograph(
                AMBIENT * shade + BRIGHTNESS / 255 * gleam * ndimage.map_coordinates(
                    pattern.astype(np.float64), thrown, order=1, mode="nearest"
                ).reshape(height, width)
            )
            for pattern in make(projector)
        ])  # fmt: skip
    return Scan(
        stack, white, black, calibration, points, lit, plane, angles, PIVOT.copy(),
        SPINDLE.copy(), BALLS.copy(),
    )  # fmt: skip


def _stand(shape: tuple[int, int], projector: tuple[int, int]) -> StereoCalibration:
    """Return a camera, and a projector on its left that looks at the same place."""
    cameras = []
    for (height, width), zoom in ((shape, 1.3), (projector, 1.25)):
        focal = zoom * min(height * 4 / 3, width)
        matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        cameras.append(Camera(matrix, LENS, (height, width)))
    turn = turned(np.array([0.0, -math.atan2(BASELINE, PIVOT[2]), 0.0]))
    shift = -turn @ [-BASELINE, 0.0, 0.0]
    left, right = cameras
    turns, shifts = np.zeros((0, 3, 3)), np.zeros((0, 3))
    return StereoCalibration(left, right, turn, shift, 0.0, turns, shifts, np.zeros(24))


def _thrown(points: np.ndarray, calibration: StereoCalibration) -> np.ndarray:
    """Return the projector row and column that light points (H, W, 3); NaN for none."""
    flat = points.reshape(-1, 3)
    found = seen(flat, calibration.right, calibration.rotation, calibration.translation)
    return found[:, ::-1].reshape(*points.shape[:-1], 2)


def _sheet(source: np.ndarray) -> np.ndarray:
    """Return the upright plane through the laser and the axis of the table."""
    normal = np.cross(PIVOT - source, SPINDLE)
    normal = normal / np.linalg.norm(normal)
    away = float(normal @ source)
    return np.append(normal, away) * (1.0 if away >= 0 else -1.0)


def _rays(camera: Camera) -> np.ndarray:
    """Return the rays (H, W, 3) of all pixels, at z = 1."""
    y, x = np.indices(camera.shape, np.float64)
    return rays_of(np.stack((x.ravel(), y.ravel()), axis=1), camera).reshape(*camera.shape, 3)


def _meet(
    rays: np.ndarray, balls: np.ndarray, wall: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest intersections of rays with the scene, and the normals; NaN for none."""
    best = np.full(rays.shape[:-1], np.inf)
    normals = np.zeros(rays.shape)
    square = (rays**2).sum(axis=-1)
    for *center, radius in balls:
        along = rays @ center
        rest = along**2 - square * (np.dot(center, center) - radius**2)
        with np.errstate(invalid="ignore"):
            depth = (along - np.sqrt(rest)) / square
        nearer = (rest > 0) & (depth > 0) & (depth < best)
        best = np.where(nearer, depth, best)
        normal = (depth[..., None] * rays - center) / radius
        normals = np.where(nearer[..., None], normal, normals)
    if wall is not None:
        depth = wall[3] / (rays @ wall[:3])
        nearer = (depth > 0) & (depth < best)
        best = np.where(nearer, depth, best)
        normals = np.where(nearer[..., None], -wall[:3] / np.linalg.norm(wall[:3]), normals)
    return np.where(np.isfinite(best), best, np.nan)[..., None] * rays, normals


def _lit(
    points: np.ndarray, source: np.ndarray, balls: np.ndarray, wall: np.ndarray | None
) -> np.ndarray:
    """Return which points are visible from the light source."""
    ways = points - source
    moved = balls - np.append(source, 0)
    shifted = None if wall is None else np.append(wall[:3], wall[3] - wall[:3] @ source)
    first, _ = _meet(ways, moved, shifted)
    with np.errstate(invalid="ignore"):
        share = (first * ways).sum(axis=-1) / (ways**2).sum(axis=-1)
        return share > 1 - 1e-6


def _shade(points: np.ndarray, normals: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Return the brightness of matt surfaces, 0 to 1, with some ambient light."""
    ways = source - points
    with np.errstate(invalid="ignore"):
        cosine = (ways * normals).sum(axis=-1) / np.linalg.norm(ways, axis=-1)
    return np.nan_to_num(0.15 + 0.85 * np.clip(cosine, 0, 1))


def _line(rays: np.ndarray, angle: float, source: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return the light of the laser on the figure when the table has turned by an angle."""
    turn = turned(angle * SPINDLE)
    balls = np.column_stack(((BALLS[:, :3] - PIVOT) @ turn.T + PIVOT, BALLS[:, 3]))
    points, normals = _meet(rays, balls, None)
    away = points @ plane[:3] - plane[3]
    light = np.exp(-0.5 * np.nan_to_num(away / WIDTH, nan=99.0) ** 2)
    shade = _shade(points, normals, source)
    lit = _lit(points, source, balls, None)
    room = AMBIENT * shade * np.isfinite(points[..., 0])
    return room + np.where(lit, BRIGHTNESS * shade * light, 0)
