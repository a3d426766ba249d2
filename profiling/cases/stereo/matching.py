"""Dense stereo: from a pair of images to disparities."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from cvkern.app.tour.stereo_errors import OFF, occluded
from profiling.case import Case, Peer, Shape, Work

SIZES = ("1024x440", "1080p")
LESS = "nothing in the first columns"  # their number is that of the disparities
# Share of the pixels that both cameras see. A matcher that fails anywhere but at rims has more.
BAD = 0.05


def disparities(shape: Shape) -> int:
    """Return how many are searched."""
    return 16 if shape[1] < 512 else 128 if shape[1] < 1920 else 256


def window(shape: Shape) -> int:
    """Return the edge of the windows: boards at toy size are no larger than 21."""
    return 7 if shape[1] < 512 else 21


@cache
def truth(shape: Shape) -> np.ndarray:
    """Return the disparity of each left pixel, NaN where the right camera does not see it.

    A slanted ground with slanted boards before it, over most of the range.
    """
    height, width = shape
    count = disparities(shape)
    y, x = np.mgrid[:height, :width] / np.array([height, width])[:, None, None]
    d = count * (0.12 + 0.25 * y + 0.03 * x)
    for top, left, near, slant in (
        (0.10, 0.25, 0.55, 0.10),
        (0.35, 0.55, 0.75, -0.12),
        (0.55, 0.30, 0.66, 0.05),
        (0.15, 0.78, 0.85, 0.00),
    ):
        board = (abs(y - top - 0.15) < 0.15) & (abs(x - left - 0.08) < 0.08)
        d[board] = count * (near + slant * (x - left))[board]
    d[occluded(d)] = np.nan
    return d


def pair(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Make two views of textured boards, uint8, with noise of their own."""
    right, hidden = _texture(shape, rng), _texture(shape, rng)
    d = truth(shape)
    columns = np.arange(shape[1]) - np.nan_to_num(d)
    before = np.minimum(np.floor(columns).astype(int), shape[1] - 2)
    part = columns - before
    left = (1 - part) * np.take_along_axis(right, before, 1)
    left += part * np.take_along_axis(right, before + 1, 1)
    left = np.where(np.isnan(d), hidden, left)
    noisy = [np.round(view + rng.normal(0, 1.5, shape)).clip(0, 255) for view in (left, right)]
    return noisy[0].astype(np.uint8), noisy[1].astype(np.uint8)


def _texture(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Return noise of several scales, about 127."""
    noise = np.zeros(shape)
    for scale in (0.7, 1.5, 3.0, 8.0):
        noise += scale * scipy.ndimage.gaussian_filter(rng.normal(size=shape), scale)
    return 127 + 45 * noise / noise.std()


def bad(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Share of the known disparities that are more than a pixel off, or missing."""
    (a,), (b,) = ours, theirs
    if a.shape != b.shape:
        return np.inf
    known = np.isfinite(b)
    return float(np.mean(~(np.abs(a[known] - b[known]) <= OFF)))


def _sgbm(mode: str, note: str = "") -> Peer:
    """OpenCV's, by absolute differences, with its sample's penalties, checks and sub-pixels."""

    def call(cv2: Any, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        matcher = cv2.StereoSGBM_create(
            minDisparity=0,
            numDisparities=disparities(left.shape),
            blockSize=5,
            P1=8 * 25,
            P2=32 * 25,
            disp12MaxDiff=1,
            uniquenessRatio=5,
            mode=getattr(cv2, f"STEREO_SGBM_MODE_{mode}"),
        )
        return matcher.compute(left, right) / np.float32(16)

    return Peer(f"OpenCV {mode}", "cv2", call, note=", ".join(filter(None, (note, LESS))))


def _bm(cv2: Any, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    matcher = cv2.StereoBM_create(disparities(left.shape), window(left.shape))
    matcher.setDisp12MaxDiff(1)
    matcher.setTextureThreshold(0)
    return matcher.compute(left, right) / np.float32(16)


def _case(
    name: str, title: str, operations: float, peers: tuple[Peer, ...], **options: Any
) -> Case:
    def call(left: Any, right: Any) -> Any:
        shape = left.shape[0], left.shape[1]
        if options.get("method") == "window":
            return cvkern.stereo_match(
                left, right, (0, disparities(shape)), window=window(shape), **options
            ).disparity
        return cvkern.stereo_match(left, right, (0, disparities(shape)), **options).disparity

    return Case(
        name=name,
        title=title,
        image=pair,
        call=call,
        oracle=lambda left, right: truth(left.shape),
        oracle_name="the disparity that the pair was made with",
        difference=bad,
        tolerance=BAD,
        bytes_per_pixel=2 + 9,
        operations_per_pixel=128 * operations,  # for 128 disparities
        peers=peers,
        # Disparity evaluations, as the field counts.
        work=Work("DE", lambda left, right: left.size * disparities(left.shape)),
        sizes=SIZES,
        most_inputs=4,
    )


CASES = (
    _case(
        "stereo_8_paths",
        "Semi-global matching, 8 paths, checked, uint8",
        8 * 7,
        (_sgbm("HH"), _sgbm("SGBM", "5 paths")),
        paths=8,
    ),
    _case(
        "stereo_4_paths",
        "Semi-global matching, 4 paths, checked, uint8",
        4 * 7,
        (_sgbm("HH4"), _sgbm("SGBM_3WAY", "3 paths")),
        paths=4,
    ),
    _case(
        "stereo_window",
        "Window matching, 21 x 21, checked, uint8",
        8,
        (Peer("OpenCV BM", "cv2", _bm, note=LESS),),
        method="window",
    ),
)
