"""Calls that make every kernel of a set compile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import cvkern
from cvkern.clouds import turntable
from cvkern.radiance import (
    Composite,
    HashField,
    MLPField,
    Scene,
    VoxelField,
    composite_rays,
    composite_rays_backward,
    fit,
    make_scene,
    positional_encoding,
    spherical_harmonics,
)

SHAPE = (24, 40)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every public function and every dtype that has own kernels."""
    noise = np.random.default_rng(0).integers(0, 256, SHAPE)
    byte, real = noise.astype(np.uint8), noise.astype(np.float32)
    color = np.repeat(real[..., None], 3, axis=2)
    taps = (0.25, 0.5, 0.25)
    for image, axis in ((real, None), (byte, None), (color, -1)):
        yield "gaussian", partial(cvkern.gaussian, image, channel_axis=axis)
        yield "box", partial(cvkern.box, image, channel_axis=axis)
        yield (
            "correlate_separable",
            partial(cvkern.correlate_separable, image, taps, channel_axis=axis),
        )
    for operator in ("gaussian", "sobel", "scharr"):
        yield "gradient", partial(cvkern.gradient, real, operator=operator)
    yield "sobel", partial(cvkern.sobel, real)
    yield "scharr", partial(cvkern.scharr, real)
    for dtype in (np.uint8, np.uint16, np.float32):
        for radius in (1, 2, 3):
            yield "median", partial(cvkern.median, noise.astype(dtype), radius)
    for norm in ("l1", "l2"):
        yield "canny", partial(cvkern.canny, byte, 0, 50, 100, operator="sobel", norm=norm)
        yield "canny", partial(cvkern.canny, real, 1, 5, 10, norm=norm)
    yield "subpixel_edges", partial(cvkern.subpixel_edges, real, 1, 5, 10)
    angles = cvkern.gradient(real).orientation
    h = cvkern.hough_line(real > 200)
    yield "hough_line", partial(cvkern.hough_line, real > 200, orientation=angles, weights=real)
    yield "hough_line_slope", partial(cvkern.hough_line_slope, real > 200)
    for votes in (h.votes, np.asarray(h.votes, np.float32)):
        yield "hough_line_peaks", partial(cvkern.hough_line_peaks, votes, h.theta, h.rho)
    yield "hough_line_segments", partial(cvkern.hough_line_segments, real > 200, [0.0], [9.0])
    for name in ("detect_lines", "detect_segments"):
        yield name, partial(getattr(cvkern, name), byte)
    yield "fit_line", partial(cvkern.fit_line, [[0, 0], [1, 2]])
    yield "suggest_line_bins", partial(cvkern.suggest_line_bins, SHAPE)
    for normalize in (True, False):
        yield "hough_circle", partial(cvkern.hough_circle, real > 200, 3, normalize=normalize)
    yield "hough_circle", partial(cvkern.hough_circle, real > 200, 3, orientation=angles)
    votes = np.asarray(noise[None], np.float32)
    yield "hough_circle_peaks", partial(cvkern.hough_circle_peaks, votes, [3])
    disc = np.hypot(*np.indices((120, 120)) - 59.0) < 40
    for dtype in (np.uint8, np.float32):
        photo = disc.astype(dtype) * dtype(255)
        yield "detect_circles", partial(cvkern.detect_circles, photo, (25, 45), high_threshold=9)
    yield "hough_ellipse", partial(cvkern.hough_ellipse, real > 240)
    yield "detect_ellipses", partial(cvkern.detect_ellipses, photo, (25, 45), high_threshold=9)
    yield "r_table", partial(cvkern.r_table, byte, low_threshold=1)
    table = cvkern.RTable(np.ones((3, 2)), np.zeros(3), np.zeros(2), (3, 3))
    yield "generalized_hough", partial(cvkern.generalized_hough, byte, table, threshold=0)
    yield "generalized_hough_votes", partial(cvkern.generalized_hough_votes, byte, table)
    yield "find_shape", partial(cvkern.find_shape, byte, byte, rotations=2)
    q = np.eye(4)
    yield "disparity_to_depth", partial(cvkern.disparity_to_depth, real, 1.0, 1.0)
    yield "points_from_disparity", partial(cvkern.points_from_disparity, real, q)
    yield "point_cloud", partial(cvkern.point_cloud, real, q, byte)
    yield "turntable", partial(turntable, real.reshape(-1, 3) + 1, byte.reshape(-1, 3), frames=1)
    for cost in ("sad", "ssd", "birchfield_tomasi", "zncc", "census", "census_symmetric"):
        for image in (byte, real):
            for window in (1, 3, 17):  # costs of uint8, uint16 and float32
                pair = partial(cvkern.stereo_cost, image, image, (0, 4), cost=cost, window=window)
                yield "stereo_cost", pair
    deep = noise[..., None] + np.arange(5)
    for costs in (deep.astype(np.uint8), deep.astype(np.uint16)):
        for paths in (4, 8, 16):
            sums = partial(cvkern.aggregate_semi_global, costs, 5, 50, paths=paths)
            yield "aggregate_semi_global", sums
        yield "winner_take_all", partial(cvkern.winner_take_all, costs)
    yield "winner_take_all", partial(cvkern.winner_take_all, deep.astype(np.float32))
    yield "left_right_check", partial(cvkern.left_right_check, real, real)
    yield "remove_speckles", partial(cvkern.remove_speckles, real)
    yield "fill_disparity", partial(cvkern.fill_disparity, real)
    yield "guided_median", partial(cvkern.guided_median, real, byte)
    for image, axis in ((byte, None), (real, None), (np.uint8(color), -1)):
        for method, paths in (("window", 8), ("semi-global", 4), ("semi-global", 8)):
            yield (
                "stereo_match",
                partial(
                    cvkern.stereo_match, image, image, (0, 8), method=method, paths=paths,
                    channel_axis=axis,
                ),
            )  # fmt: skip
    samples = real[:, 0], real[:, :3], real[:, :2], np.array([[0, 4]])
    seen = Composite(real[:1, :3], real[0, :1], real[0, :1], real[0, :1])
    yield "composite_rays", partial(composite_rays, *samples)
    yield "composite_rays_backward", partial(composite_rays_backward, seen, *samples)
    yield "positional_encoding", partial(positional_encoding, real)
    yield "spherical_harmonics", partial(spherical_harmonics, color)
    yield "make_scene", _scene
    for field in (
        VoxelField(resolutions=(16, 32), shares=(0.3,), rays=64),
        HashField(table_bits=10, samples=2**12, rays=64, cells=32),
        # Kernels are made for widths, which are the default's.
        MLPField(samples=2**8, rays=16, cells=8, steps=16),
    ):
        yield "fit", partial(_train, field)


def _scene() -> Scene:
    return make_scene(train=2, test=1, size=16)


def _train(field: Any) -> None:
    """Train for as long as a grid takes to be made finer."""
    fit(_scene(), field, steps=18, background="learnt", progress=False)
