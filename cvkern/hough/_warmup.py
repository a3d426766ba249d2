"""Calls that compile the kernels of Hough transforms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern import hough
from cvkern.app.warmup import pictures
from cvkern.filters import gradient


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function, and for every dtype with its own kernels."""
    byte, real, _ = pictures()
    mask, angles = real > 200, gradient(real).orientation
    h = hough.hough_line(mask)
    yield "hough_line", partial(hough.hough_line, mask, orientation=angles, weights=real)
    yield "hough_line_slope", partial(hough.hough_line_slope, mask)
    for votes in (h.votes, np.asarray(h.votes, np.float32)):
        yield "hough_line_peaks", partial(hough.hough_line_peaks, votes, h.theta, h.rho)
    yield "hough_line_segments", partial(hough.hough_line_segments, mask, [0.0], [9.0])
    yield "probabilistic_hough_line", partial(hough.probabilistic_hough_line, mask, rng=0)
    yield "detect_lines", partial(hough.detect_lines, byte)
    square = np.zeros((24, 40), np.uint8)
    square[6:18, 8:32] = 200  # noise has no segments, for which there are further kernels
    yield "detect_segments", partial(hough.detect_segments, square)
    yield "fit_line", partial(hough.fit_line, [[0, 0], [1, 2]])
    yield "suggest_line_bins", partial(hough.suggest_line_bins, byte.shape)
    for normalize in (True, False):
        yield "hough_circle", partial(hough.hough_circle, mask, 3, normalize=normalize)
    yield "hough_circle", partial(hough.hough_circle, mask, 3, orientation=angles)
    yield "hough_circle_peaks", partial(hough.hough_circle_peaks, real[None], [3])
    disc = np.hypot(*np.indices((120, 120)) - 59.0) < 40
    photo = disc * np.float32(255)
    for dtype in (np.uint8, np.float32):
        call = partial(hough.detect_circles, photo.astype(dtype), (25, 45), high_threshold=9)
        yield "detect_circles", call
    colors = np.repeat(photo[..., None].astype(np.uint8), 3, axis=2)
    yield "detect_circles", partial(hough.detect_circles, colors, (25, 45), high_threshold=9)
    yield "hough_ellipse", partial(hough.hough_ellipse, real > 240)
    yield "detect_ellipses", partial(hough.detect_ellipses, photo, (25, 45), high_threshold=9)
    yield "r_table", partial(hough.r_table, byte, low_threshold=1)
    table = hough.RTable(np.ones((3, 2)), np.zeros(3), np.zeros(2), (3, 3))
    yield "generalized_hough", partial(hough.generalized_hough, byte, table, threshold=0)
    yield "generalized_hough_votes", partial(hough.generalized_hough_votes, byte, table)
    yield "detect_shape", partial(hough.detect_shape, byte, byte, rotations=2)
