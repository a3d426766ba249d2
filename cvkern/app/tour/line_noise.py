"""How clearly the peak of a line stands out: an experiment with points of known lines."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

import cvkern

SIDE = 256  # pixels of the image
POINTS = 60  # points on the line
CLUTTER = 1500  # points with random positions and directions
DIRECTION_ERROR = math.radians(3)  # standard deviation of the gradients of the line's points
TOLERANCE = 2 * DIRECTION_ERROR
SMOOTHING = (1.5, 0.0)  # bins of rho and theta: noise spreads votes along rho
NOISE = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # pixels
BINS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0)  # pixels
BIN_NOISE = 0.5  # pixels: noise in the experiment with the size of the bins
WAYS = ("plain", "smoothed", "directed")


class Points(NamedTuple):
    """The points of a line and clutter, and the parameters of the line."""

    points: np.ndarray
    orientation: np.ndarray
    theta: float
    rho: float


def by_noise(trials: int, seed: int = 0) -> dict[str, dict[str, list[float]]]:
    """Return, for each way of voting and each of `NOISE`, means over the trials.

    'height' is the peak divided by the number of the line's points. 'lead' is the peak divided by
    the highest bin that is not near the line.
    """
    found = {way: {"height": [], "lead": []} for way in WAYS}
    for noise in NOISE:
        results = _trials(trials, seed, noise, 1.0)
        for i, way in enumerate(WAYS):
            heights, others = np.array([r[i][:2] for r in results]).T
            found[way]["height"].append(float(np.mean(heights) / POINTS))
            found[way]["lead"].append(float(np.mean(heights / others)))
    return found


def by_bins(trials: int, seed: int = 0) -> dict[str, list[float]]:
    """Return, for each way of voting and each of `BINS`, the mean number of false peaks."""
    found = {way: [] for way in WAYS}
    for step in BINS:
        results = _trials(trials, seed, BIN_NOISE, step)
        for i, way in enumerate(WAYS):
            found[way].append(float(np.mean([r[i][2] for r in results])))
    return found


def scatter(rng: np.random.Generator, noise: float) -> Points:
    """Return the points of a line through the middle of the image, and clutter."""
    theta, off = rng.uniform(-math.pi / 2, math.pi / 2), rng.uniform(-SIDE / 4, SIDE / 4)
    c, s = math.cos(theta), math.sin(theta)
    rho = SIDE / 2 * (c + s) + off
    t = rng.uniform(-SIDE / 3, SIDE / 3, POINTS)
    across = off + rng.normal(0, noise, POINTS)
    line = SIDE / 2 + np.stack((across * s + t * c, across * c - t * s), axis=1)
    points = np.concatenate((line, rng.uniform(0, SIDE - 1, (CLUTTER, 2))))
    directions = theta + rng.normal(0, DIRECTION_ERROR, POINTS)
    anywhere = rng.uniform(-math.pi, math.pi, CLUTTER)
    return Points(
        points.clip(0, SIDE - 1).astype(np.float32),
        np.concatenate((directions, anywhere)).astype(np.float32),
        theta,
        rho,
    )


def plot(size: tuple[int, int] = (1500, 480), trials: int = 8) -> np.ndarray:
    """Return the two experiments as a picture, (H, W, 3) uint8."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    dpi = 120
    figure = Figure(figsize=(size[0] / dpi, size[1] / dpi), dpi=dpi, layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    noise, bins = by_noise(trials), by_bins(trials)
    for way in WAYS:
        left.plot(NOISE, noise[way]["height"], label=way, marker="o", markersize=3)
        middle.plot(NOISE, noise[way]["lead"], marker="o", markersize=3)
        right.plot(BINS, bins[way], marker="o", markersize=3)
    middle.axhline(1, color="0.6", linewidth=0.8)
    for axes, x, y in (
        (left, "noise [pixels]", "peak, of the line's points"),
        (middle, "noise [pixels]", "peak over the highest other bin"),
        (right, "bin of rho [pixels]", "false peaks"),
    ):
        axes.set(xlabel=x, ylabel=y)
        axes.set_ylim(bottom=0)
    left.legend(frameon=False)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _trials(
    trials: int, seed: int, noise: float, step: float
) -> list[list[tuple[float, float, int]]]:
    rng = np.random.default_rng(seed)
    return [_trial(scatter(rng, noise), step) for _ in range(trials)]


def _trial(scene: Points, step: float) -> list[tuple[float, float, int]]:
    """Return peak, highest other bin and number of false peaks, for each of `WAYS`."""
    options: dict[str, Any] = {"points": scene.points, "shape": (SIDE, SIDE), "rho_step": step}
    plain = cvkern.hough_line(**options)
    directed = cvkern.hough_line(
        **options, orientation=scene.orientation, orientation_tolerance=TOLERANCE
    )
    votes = plain.votes.astype(np.float32)
    accumulators = (votes, cvkern.gaussian(votes, SMOOTHING), directed.votes.astype(np.float32))
    # Bins near the line, and near it half a turn further, where rho has the other sign.
    turn = np.round((plain.theta - scene.theta) / math.pi)
    angle = np.abs(plain.theta - scene.theta - math.pi * turn)
    rho = np.where(turn % 2 == 0, scene.rho, -scene.rho)
    near = (angle < math.radians(10)) & (
        np.abs(plain.rho[:, None] - rho) < 10 + 3 * step + SIDE * angle
    )
    results = []
    for values in accumulators:
        peak = float(values[near].max())
        peaks = cvkern.hough_line_peaks(values, plain.theta, plain.rho, threshold=0.5 * peak)
        rows = np.round(peaks.rho / step).astype(int) + len(plain.rho) // 2
        columns = np.searchsorted(plain.theta, peaks.theta)
        results.append((peak, float(values[~near].max()), int((~near[rows, columns]).sum())))
    return results
