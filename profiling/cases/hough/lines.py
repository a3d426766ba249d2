"""Lines: votes for them, and the segments of a photograph."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cvkern
from profiling.arrays import photograph_uint8
from profiling.case import Case, Peer, Shape, Work

DEGREES, TENTHS = (np.linspace(-math.pi / 2, math.pi / 2, n, endpoint=False) for n in (180, 1800))
AIM = math.radians(2)  # how far a directed vote may be from the gradient
NEAR_A_TIE = 3e-3  # share of bins that may differ: at 30 degrees half of all votes are near a tie
SIDE = 48  # pixels of the square around a drawn rectangle
FOUND = math.cos(math.radians(2)), 2.0  # angle and pixels within which two segments are one

Arrays = tuple[np.ndarray, ...]


def _edges(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Edges on all that can be one: a tenth of the pixels."""
    photo = photograph_uint8(shape, rng)
    return cvkern.canny(photo, 0, 12, 30, suppression="sectors", mode="nearest")


def _directed(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    photo = photograph_uint8(shape, rng)
    mask = cvkern.canny(photo, 0, 12, 30, suppression="sectors", mode="nearest")
    return mask, cvkern.gradient(photo).orientation


def _votes(mask: np.ndarray, theta: np.ndarray, allowed: Any = None) -> Arrays:
    """The votes by NumPy, rho in float64."""
    y, x = np.nonzero(mask)
    reach = math.ceil(math.hypot(*mask.shape))
    votes = np.empty((2 * reach + 1, len(theta)), np.int32)
    for t, angle in enumerate(theta):
        bins = np.floor(x * math.cos(angle) + y * math.sin(angle) + (reach + 0.5)).astype(np.intp)
        chosen = bins if allowed is None else bins[allowed(angle)]
        votes[:, t] = np.bincount(chosen, minlength=len(votes))
    return (votes,)


def _allowed(mask: np.ndarray, orientation: np.ndarray) -> Any:
    """Tell which points vote for an angle: the direction counts as the nearest of 16384."""
    code = np.floor(orientation[mask] * np.float32(16384 / (2 * math.pi)) + np.float32(0.5))
    direction = code * (2 * math.pi / 16384)

    def at(angle: float) -> np.ndarray:
        off = (direction - angle + math.pi / 2) % math.pi - math.pi / 2
        return np.abs(off) <= AIM + 1e-9

    return at


def _differing(ours: Arrays, right: Arrays) -> float:
    """Share of the bins that differ; all, for an answer that is no accumulator."""
    a, b = ours[0], right[0]
    return float(np.mean(a != b)) if a.shape == b.shape else 1.0


def _plain(number: int, theta: np.ndarray) -> Case:
    return Case(
        name=f"hough_line_{number}",
        title=f"Votes for lines, {number} angles, dense edges of a photograph",
        image=_edges,
        call=lambda x: cvkern.hough_line(x, theta).votes,
        oracle=lambda x: _votes(x, theta),
        oracle_name="the same by NumPy in float64",
        difference=_differing,
        tolerance=NEAR_A_TIE,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x: _lines_of_opencv(m, x, number),
                note="finds the peaks as well, here none, and gives no votes",
            ),
            Peer("scikit-image", "skimage.transform", lambda m, x: m.hough_line(x, theta)[0]),
        ),
        work=Work("votes", lambda x: float(x.sum()) * number),
        most_inputs=4,
        margin=0,
    )


def _lines_of_opencv(cv2: Any, mask: np.ndarray, number: int) -> np.ndarray:
    found = cv2.HoughLines(mask.view(np.uint8), 1, math.pi / number, 1 << 20)
    return np.zeros((0, 2)) if found is None else found.reshape(-1, 2)


def _segments_of_opencv(cv2: Any, image: np.ndarray) -> np.ndarray:
    edges = cv2.Canny(image, 50, 150, L2gradient=True)
    found = cv2.HoughLinesP(edges, 0.5, math.pi / 360, 20, minLineLength=10, maxLineGap=5)
    return np.zeros((0, 4)) if found is None else found.reshape(-1, 4)[:, [1, 0, 3, 2]]


def _segments_of_lsd(cv2: Any, image: np.ndarray) -> np.ndarray:
    found = cv2.createLineSegmentDetector().detect(image)[0]
    return np.zeros((0, 4)) if found is None else found.reshape(-1, 4)[:, [1, 0, 3, 2]]


def _drawing(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """A noisy picture of bright rectangles, each turned by an angle of its own."""
    y, x = np.mgrid[-SIDE // 2 : SIDE // 2, -SIDE // 2 : SIDE // 2].astype(np.float32)
    picture = np.full(shape, 60, np.float32)
    for row, column, down, along in _rectangles(shape):
        top, left = row - SIDE // 2, column - SIDE // 2
        picture[top : top + SIDE, left : left + SIDE] += 110 * _inside(y, x, down, along)
    return (picture + rng.normal(0, 4, shape)).clip(0, 255).astype(np.uint8)


def _rectangles(shape: Shape) -> list[tuple[int, int, float, float]]:
    """Centre of each rectangle, and the half of its longer axis."""
    return [
        (row, column, 18 * math.sin(0.7 * i), 18 * math.cos(0.7 * i))
        for i, (row, column) in enumerate(
            (r, c)
            for r in range(SIDE // 2, shape[0] - SIDE // 2 + 1, SIDE)
            for c in range(SIDE // 2, shape[1] - SIDE // 2 + 1, SIDE)
        )
    ]


def _inside(dy: np.ndarray, dx: np.ndarray, down: float, along: float) -> np.ndarray:
    """The share of each pixel inside a rectangle twice as long as wide."""
    length = math.hypot(down, along)
    forth = np.abs(dy * down + dx * along) / length
    aside = np.abs(dx * down - dy * along) / length
    return (np.minimum(length - forth, length / 2 - aside) + 0.5).clip(0, 1)


def _sides(image: np.ndarray) -> Arrays:
    """The sides of the rectangles, (N, 4)."""
    sides = []
    for row, column, down, along in _rectangles(image.shape):
        a, b = np.array([down, along]), np.array([along, -down]) / 2
        corners = np.array([row, column]) + np.array([a + b, a - b, -a - b, b - a])
        sides.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
    return (np.concatenate(sides),)


def _missed(ours: Arrays, right: Arrays) -> float:
    """Share of the sides without a segment along them over half their length or more."""
    (segments,), (sides,) = ours, right
    if not len(segments):
        return 1.0
    begin, end = segments[:, :2].astype(float), segments[:, 2:].astype(float)
    direction = (end - begin) / np.hypot(*(end - begin).T)[:, None]
    missed = 0
    for side in sides:
        along = (side[2:] - side[:2]) / np.hypot(*(side[2:] - side[:2]))
        across = np.array([along[1], -along[0]])
        away = np.abs(((begin + end) / 2 - side[:2]) @ across)
        places = np.sort([(begin - side[:2]) @ along, (end - side[:2]) @ along], axis=0)
        length = np.hypot(*(side[2:] - side[:2]))
        overlap = np.minimum(places[1], length) - np.maximum(places[0], 0)
        good = (np.abs(direction @ along) > FOUND[0]) & (away < FOUND[1])
        missed += not (good & (overlap > length / 2)).any()
    return missed / len(sides)


CASES = (
    _plain(180, DEGREES),
    _plain(1800, TENTHS),
    Case(
        name="hough_line_directed",
        title="Votes for lines across the gradient, 1800 angles",
        image=_directed,
        call=lambda x, o: (
            cvkern.hough_line(x, TENTHS, orientation=o, orientation_tolerance=AIM).votes
        ),
        oracle=lambda x, o: _votes(x, TENTHS, _allowed(x, o)),
        oracle_name="the same by NumPy in float64",
        difference=_differing,
        tolerance=NEAR_A_TIE,
        bytes_per_pixel=5,
        operations_per_pixel=0,
        captures=False,
        work=Work("votes", lambda x, o: float(x.sum()) * 2 * AIM / math.pi * len(TENTHS)),
        most_inputs=4,
        margin=0,
    ),
    Case(
        name="detect_segments",
        title="Segments of a drawing, from pixels to end points",
        image=_drawing,
        call=lambda x: cvkern.detect_segments(x, 1.5),
        oracle=_sides,
        oracle_name="the sides that were drawn",
        difference=_missed,
        tolerance=0.05,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(
            Peer("OpenCV HoughLinesP", "cv2", _segments_of_opencv, note="with Canny"),
            Peer("OpenCV LSD", "cv2", _segments_of_lsd),
        ),
        captures=False,
        sizes=("1080p",),
        most_inputs=4,
        margin=0,
    ),
)
