"""Scanning with light: a board and its camera, patterns of a projector, a laser."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.clouds import turntable
from cvkern.images.colors import apply_colormap
from cvkern.images.drawing import draw_points
from cvkern.structured_light import Scan

NEAR, FAR = 5.0, 8.0  # depths that the maps show
NOTHING = (0, 0, 0)
BOARD = 5, 7
TILTS = ((0.5, 0.0, 0.1), (-0.2, 0.5, -0.2), (-0.5, -0.3, 0.3), (0.3, -0.5, 0.0))
LENS = (-0.3, 0.1)
FRAMES = 40  # turns of the table


def chapter() -> Chapter:
    """Return the chapter on scanning."""
    return Chapter(
        "scanning",
        "Scanning",
        "Light that is known turns a camera into a scanner: stripes that count the columns of a "
        "projector, fringes between them, a line of laser light. The scenes are rendered, so the "
        "truth is known.",
        (_board, _gray, _fringes, _laser),
    )


def _board(clock: Clock) -> Figure:
    camera = cvkern.Camera([[420, 0, 203], [0, 420, 148], [0, 0, 1]], LENS, (300, 400))  # pyright: ignore[reportArgumentType]
    board = cvkern.chessboard_points(BOARD)
    views, corners, rays = [], [], _rays(camera)
    for n, turn in enumerate(TILTS):
        view = _seen(camera.shape, rays, np.array(turn), n)
        views.append(view)
        corners.append(clock(cvkern.detect_chessboard, view, BOARD))
    found = cvkern.calibrate_camera(board, corners, camera.shape, fixed=("k3", "p1", "p2"))
    marked = views[0]
    for row in range(BOARD[0]):
        share = row / (BOARD[0] - 1)
        color = (int(255 * (1 - share)), 70, int(255 * share))
        part = corners[0][BOARD[1] * row : BOARD[1] * (row + 1)]
        marked = draw_points(marked, part, color=color, radius=4.0)
    flat = clock(cvkern.undistort, views[0], found.camera)
    return Figure(
        "A board tells the camera",
        "Where four squares meet, two edges cross: their places are fitted to a hundredth of a "
        "pixel, row by row. A few views of the board then tell focal length, principal point and "
        f"lens; here the corners are met to {found.rms:.3f} pixels, and the focal length is found "
        f"as {found.matrix[0, 0]:.1f} of 420. Without the bend of the lens, edges are straight.",
        "corners = [cvkern.detect_chessboard(view, (5, 7)) for view in views]\n"
        "board = cvkern.chessboard_points((5, 7))\n"
        "found = cvkern.calibrate_camera(board, corners, views[0].shape)\n"
        "flat = cvkern.undistort(views[0], found.camera)",
        (
            Panel("scanning-board", views[0], "One of four views"),
            Panel("scanning-corners", marked, "Its corners: rows from red to blue"),
            Panel("scanning-flat", flat, "Without the bend of the lens"),
        ),
        clock.take(),
    )


def _rays(camera: cvkern.Camera) -> np.ndarray:
    """Return the rays of nine places of each pixel."""
    from cvkern.geometry.cameras.lens import rays_of

    height, width = camera.shape
    y, x = (np.indices((3 * height, 3 * width)) - 1) / 3
    return rays_of(np.stack((x.ravel(), y.ravel()), axis=1), camera)


def _seen(shape: tuple[int, int], rays: np.ndarray, turn: np.ndarray, seed: int) -> np.ndarray:
    """Render a board, three times finer and then averaged."""
    from cvkern.geometry.cameras.lens import turned

    rotation = turned(turn)
    shift = np.array([0, 0, 13.0]) - rotation @ [(BOARD[1] - 1) / 2, (BOARD[0] - 1) / 2, 0]
    height, width = shape
    along = (rotation[:, 2] @ shift) / (rays @ rotation[:, 2])
    u, v, _ = ((rays * along[:, None] - shift) @ rotation).T
    i, j = np.floor(v), np.floor(u)
    dark = ((i + j) % 2 == 0) & (i >= -1) & (j >= -1) & (i < BOARD[0]) & (j < BOARD[1])
    sheet = (u > -1.6) & (v > -1.6) & (u < BOARD[1] + 0.6) & (v < BOARD[0] + 0.6)
    light = np.where(dark, 35.0, np.where(sheet, 225.0, 110.0))
    light = light.reshape(height, 3, width, 3).mean(axis=(1, 3))
    noise = np.random.default_rng(seed).normal(0, 3, light.shape)
    return (cvkern.gaussian(light, 0.7) + noise).clip(0, 255).round().astype(np.uint8)


@lru_cache(3)
def _scan(kind: str) -> Scan:
    return cvkern.make_scan(kind, (180, 240) if kind == "laser" else (240, 320), frames=FRAMES)


def _depth(points: np.ndarray) -> np.ndarray:
    depth = points[..., 2].astype(np.float32)
    return apply_colormap(-depth, vmin=-FAR, vmax=-NEAR, nan=NOTHING)


def _error(points: np.ndarray, scan: Scan) -> tuple[np.ndarray, float]:
    """Return a picture of how far points are from the truth, and the median."""
    off = np.linalg.norm(points - scan.points, axis=2).astype(np.float32)
    off[~scan.lit] = np.nan
    picture = apply_colormap(off.clip(0, 0.05), vmin=0, vmax=0.05, nan=NOTHING)
    return picture, float(np.nanmedian(off))


def _gray(clock: Clock) -> Figure:
    scan = _scan("gray_code")
    shape = scan.calibration.right.shape
    found = clock(cvkern.decode_gray_code, scan.frames, shape, scan.white, scan.black)
    points = clock(cvkern.triangulate_columns, found.columns, scan.calibration, found.valid)
    picture, median = _error(points, scan)
    return Figure(
        "Gray code",
        "Each pattern tells one bit of the projector's column; each comes with its inverse, so "
        "paint and shade do not matter. The ray of a pixel meets the plane of its column. Columns "
        f"are whole, so depth comes in steps: half of the points are within {median:.3f} of the "
        "truth, at a distance of 6. Dark pixels saw no light, or lie between two stripes.",
        "found = cvkern.decode_gray_code(frames, (240, 320), white, black)\n"
        "points = cvkern.triangulate_columns(found.columns, calibration, found.valid)",
        (
            Panel("scanning-gray", scan.frames[8], "One of 34 patterns"),
            Panel("scanning-gray-depth", _depth(points), "Depth: bright is near"),
            Panel("scanning-truth", _depth(scan.points), "The truth"),
            Panel("scanning-gray-error", picture, "Distance from the truth, white for 0.05"),
        ),
        clock.take(),
    )


def _fringes(clock: Clock) -> Figure:
    scan = _scan("phase_shift")
    shape = scan.calibration.right.shape
    found = clock(cvkern.decode_phase_shift, scan.frames, shape)
    points = clock(cvkern.triangulate_columns, found.columns, scan.calibration, found.valid)
    picture, median = _error(points, scan)
    known = np.isfinite(points).all(axis=2)
    shades = np.repeat(scan.white[known][:, None], 3, axis=1)
    film = clock(turntable, points[known], shades, shape=(240, 320), frames=36)
    phase = apply_colormap(found.phase[0], vmin=-np.pi, vmax=np.pi)
    return Figure(
        "Shifted fringes",
        "Four shifts of a fringe tell a phase, and three fringes, each finer than the one before, "
        f"tell the place between columns: half of the points are within {median:.4f} of the truth.",
        "found = cvkern.decode_phase_shift(frames, (240, 320))\n"
        "points = cvkern.triangulate_columns(found.columns, calibration, found.valid)",
        (
            Panel("scanning-fringes", scan.frames[4], "One of 24 patterns"),
            Panel("scanning-phase", phase, "Phase of the finest fringe"),
            Panel("scanning-fringes-error", picture, "Distance from the truth, white for 0.05"),
            Panel("scanning-cloud", film, "The points, turned"),
        ),
        clock.take(),
    )


def _laser(clock: Clock) -> Figure:
    scan = _scan("laser")
    lines = clock(cvkern.detect_laser_lines, scan.frames, axis=1, sigma=1.5, threshold=40)
    points = cvkern.triangulate_lines(
        lines.positions, scan.calibration.left, scan.plane, axis=1, angles=scan.angles,
        pivot=scan.pivot, spindle=scan.spindle,
    )  # fmt: skip
    cloud = points[np.isfinite(points).all(axis=2)]
    gaps = np.linalg.norm(cloud[:, None] - scan.balls[:, :3], axis=2) - scan.balls[:, 3]
    median = float(np.median(np.abs(gaps).min(axis=1)))
    height = apply_colormap(cloud[None, :, 1])[0]
    film = clock(turntable, cloud, height, shape=(240, 320), frames=36)
    frame = np.repeat(scan.frames[0][..., None], 3, axis=2)
    rows = np.arange(len(frame), dtype=np.float32)
    there = np.isfinite(lines.positions[0])
    places = np.stack((rows, lines.positions[0]), axis=1)[there]
    shown = draw_points(frame, places, color=(255, 60, 40), radius=1.0)
    return Figure(
        "A laser and a turn-table",
        "A sheet of laser light draws a line on the figure, which is found within the pixel in "
        "each row. The plane of the light tells its depth, and the turn of the table where it "
        f"belongs: {len(cloud)} points of {FRAMES} frames, half of them within {median:.4f} of the "
        "figure.",
        "lines = cvkern.detect_laser_lines(frames, axis=1)\n"
        "points = cvkern.triangulate_lines(\n"
        "    lines.positions, camera, plane, axis=1, angles=angles, pivot=pivot,\n"
        ")",
        (
            Panel("scanning-laser", scan.frames[0], f"The first of {FRAMES} frames"),
            Panel("scanning-line", shown, "The line, where it was found"),
            Panel("scanning-figure", film, "All points, coloured by height"),
        ),
        clock.take(),
    )
