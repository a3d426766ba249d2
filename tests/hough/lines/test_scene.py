"""Lines and segments of a rendered scene: crossings, parallels 4 pixels apart, and clutter.

The bounds are twice what was measured.
"""

from typing import Any

import numpy as np
import pytest

import cvkern
from tests.hough.lines.reference_scene import SHAPE, scene

EDGES: dict[str, Any] = {"sigma": 1.0, "low_threshold": 60, "high_threshold": 120}


def compare(segment, side):
    """Return degrees between two segments, and across and along how far their ends are apart."""
    length = np.hypot(*(side[2:] - side[:2]))
    along = (side[2:] - side[:2]) / length
    across = np.array([along[1], -along[0]])
    step = segment[2:] - segment[:2]
    degrees = np.degrees(np.arcsin(abs(step @ across) / np.hypot(*step)))
    ends = segment.reshape(2, 2) - side[:2]
    gaps = np.sort(ends @ along) - (0, length)
    return degrees, np.abs(ends @ across).max(), np.abs(gaps).max()


@pytest.mark.parametrize("noise", [0, 6])
def test_every_edge_is_one_segment(backend, noise):
    picture, edges = scene(noise)
    segments = cvkern.detect_segments(picture, **EDGES).astype(float)
    assert len(segments) == len(edges)
    for side in edges:
        degrees, away, gap = min((compare(s, side) for s in segments), key=lambda c: c[1] + c[2])
        long = np.hypot(*(side[2:] - side[:2])) > 20  # the bar's ends have 16 pixels
        assert degrees < (0.05 if long else 0.7)
        assert away < (0.06 if long else 0.1)
        assert gap < 6.8  # blurred corners are round


@pytest.mark.parametrize("noise", [0, 6])
def test_every_straight_line_is_found_once(backend, noise):
    picture, edges = scene(noise)
    found = cvkern.detect_lines(picture, **EDGES, min_votes=60)
    assert len(found.rho) == 10  # both parts of a cut edge are on one line
    normal = np.stack([np.sin(found.theta), np.cos(found.theta)])
    middle = np.array(SHAPE) / 2  # a line is compared at its point nearest to the middle
    for begin, end in (e.reshape(2, 2) for e in edges if np.hypot(*(e[2:] - e[:2])) > 20):
        along = (end - begin) / np.hypot(*(end - begin))
        degrees = np.degrees(np.arcsin(np.abs(along @ normal)))
        point = begin + ((middle - begin) @ along) * along
        away = np.abs(point @ normal - found.rho)
        assert ((degrees < 0.03) & (away < 0.07)).sum() == 1
