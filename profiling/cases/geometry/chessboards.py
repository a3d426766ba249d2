"""Corners of a chessboard in a photograph."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work

BOARD = 6, 9
NOISE, DARK, BRIGHT = 2.0, 40.0, 220.0
LIMIT = 0.5  # pixels: edges are drawn without half tones, in squares of 8 pixels and more


def _plane(shape: Shape) -> np.ndarray:
    """Return the homography from the board, (x, y, 1) in squares, to the pixels of a picture."""
    height, width = shape
    square = min(height / 10, width / 14)
    tilted = np.array([[1, 0.1, 0], [-0.15, 0.9, 0], [0.02, 0.01, 1]])
    middle = tilted @ [(BOARD[1] - 1) / 2, (BOARD[0] - 1) / 2, 1]
    move = np.diag([square, square, 1])
    move[:2, 2] = np.array([width / 2, height / 2]) - square * middle[:2] / middle[2]
    return move @ tilted


def _photograph(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Photograph a board, in colour."""
    back = np.linalg.inv(_plane(shape))
    y, x = np.indices(shape, np.float32)
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in back)
    i, j = np.floor(v / w), np.floor(u / w)
    dark = ((i + j) % 2 == 0) & (i >= -1) & (j >= -1) & (i < BOARD[0]) & (j < BOARD[1])
    seen = cvkern.gaussian(np.where(dark, DARK, BRIGHT), 1.0)
    seen = seen + rng.normal(0, NOISE, shape)
    return np.repeat(seen.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def _corners(image: np.ndarray) -> np.ndarray:
    i, j = np.indices(BOARD).reshape(2, -1)
    x, y, w = _plane(image.shape[:2]) @ np.stack((j, i, np.ones_like(i)))
    return np.stack((y / w, x / w), axis=1)


def _farthest(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    """The largest distance of a corner from where it is; a board may be read from its end."""
    gaps = [np.hypot(*(one - right[0]).T).max() for one in (ours[0], ours[0][::-1])]
    return float(min(gaps))


def _sectors(cv2: Any, image: np.ndarray) -> np.ndarray:
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = cv2.findChessboardCornersSB(gray, BOARD[::-1])[1]
    return found.reshape(-1, 2)[:, ::-1]


CASES = (
    Case(
        name="detect_chessboard",
        title="Chessboard of 6 x 9 corners in a colour photograph, uint8",
        image=_photograph,
        call=lambda image: cvkern.detect_chessboard(image, BOARD),
        oracle=_corners,
        oracle_name="the corners of the map that made the photograph",
        difference=_farthest,
        tolerance=LIMIT,
        bytes_per_pixel=3,
        operations_per_pixel=0,
        peers=(Peer("OpenCV, SB", "cv2", _sectors),),
        captures=False,
        work=Work("pixels", lambda image: image.shape[0] * image.shape[1]),
        sizes=("VGA", "1080p", "4K"),
        most_inputs=2,
        margin=0,
    ),
)
