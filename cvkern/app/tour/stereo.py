"""Stereo: disparity, depth, and their errors."""

from __future__ import annotations

import io

import numpy as np

import cvkern
from cvkern.app.tour import stereo_errors
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.clouds import turntable
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import overlay_mask

DISPARITIES = (0, 64)
# The camera of scikit-image's motorcycle pair, in pixels and millimetres.
CAMERA = {"focal": 994.978, "baseline": 193.001, "doffs": 31.086}
CENTRE = {"cx": 311.193, "cy": 254.877}
WINDOWS = (3, 5, 7, 11, 15, 21, 31)
SHOWN = (3, 11, 31)  # windows whose maps are shown
DIMMED = 0.6  # light of the right camera, as a share of the left one's
HIDDEN, PLAIN, OTHER = (255, 150, 40), (70, 130, 255), (255, 40, 90)


def chapter() -> Chapter:
    """Return the chapter on stereo."""
    return Chapter(
        "stereo",
        "Stereo",
        "Near objects shift more between the two views than far ones. Find the position of each "
        "left pixel in the right image: its shift, the disparity, gives its depth.",
        (_match, _cloud, _windows, _errors, _brightness),
    )


def _pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the motorcycle pair and its measured disparity, NaN where it is unknown."""
    from skimage import data

    left, right, truth = data.stereo_motorcycle()
    return left, right, np.where(np.isfinite(truth), truth, np.float32(np.nan))


def _match(clock: Clock) -> Figure:
    left, right, truth = _pair()
    found = clock(cvkern.stereo_match, left, right, disparities=DISPARITIES, channel_axis=-1)
    clock(cvkern.stereo_match, left, right, disparities=DISPARITIES, channel_axis=-1, paths=4)
    clock(
        cvkern.stereo_match, left, right, disparities=DISPARITIES, channel_axis=-1, method="window"
    )
    off = np.abs(found.disparity - truth)
    share = stereo_errors.bad(found.disparity, truth).sum() / np.isfinite(truth).sum()
    return Figure(
        "Eight paths to every pixel",
        "A single pixel matches in many places. Semi-global matching follows eight paths to each "
        "pixel, and finds the disparity that matches best with few jumps along the path. Where the "
        "right camera sees nothing to match, the disparity comes from the background beside it. "
        f"Against the ground truth, {share:.1%} of the pixels are off by more than one.",
        "found = cvkern.stereo_match(\n"
        "    left, right, disparities=(0, 64), channel_axis=-1,\n"
        ")\n"
        "found.disparity, found.valid, found.confidence",
        (
            Panel("stereo-left", left, "The left photograph, `skimage.data.stereo_motorcycle()`"),
            Panel("stereo-disparity", _shown(found.disparity), "Disparity: bright means near"),
            Panel("stereo-truth", _shown(truth), "Ground truth; black where it is unknown"),
            Panel(
                "stereo-error",
                apply_colormap(off.clip(0, 4), vmin=0, vmax=4, nan=(0, 0, 0)),
                "Error: dark is right, white is off by four pixels or more",
            ),
        ),
        clock.take(),
    )


def _cloud(clock: Clock) -> Figure:
    left, right, _ = _pair()
    found = cvkern.stereo_match(left, right, DISPARITIES, channel_axis=-1)
    depth = clock(cvkern.disparity_to_depth, found.disparity, **CAMERA)
    q = cvkern.reprojection_matrix(**CAMERA, **CENTRE)
    cloud = cvkern.point_cloud(found.disparity, q, left, found.valid)
    movie = turntable(*cloud, shape=(270, 400), frames=40)
    near, far = np.quantile(depth[found.valid], (0.01, 0.99)) / 1000
    return Figure(
        "A photograph to look around in",
        "The focal length and the distance between the cameras turn disparity into metres, and "
        f"each pixel into a point: {len(cloud.points):,} of them, {near:.1f} to {far:.1f} m away. "
        "Pixels that only one camera saw, or on which the two disagree, are black.",
        "q = cvkern.reprojection_matrix(\n"
        "    focal=994.978, baseline=193.001, doffs=31.086,\n"
        "    cx=311.193, cy=254.877,\n"
        ")\n"
        "cloud = cvkern.point_cloud(found.disparity, q, left, found.valid)\n"
        'write_animation("cloud.gif", turntable(*cloud))\n'
        'write_ply("cloud.ply", *cloud)',
        (
            Panel("stereo-cloud", movie, "The points, from a camera that swings around them"),
            Panel(
                "stereo-depth",
                apply_colormap(-depth, vmin=-1000 * far, vmax=-1000 * near, nan=(0, 0, 0)),
                f"Depth: bright is {near:.1f} m, dark is {far:.1f} m",
            ),
        ),
        clock.take(),
    )


def _windows(clock: Clock) -> Figure:
    left, right, truth = _pair()
    maps, shares = stereo_errors.sweep(left, right, truth, DISPARITIES, WINDOWS)
    panels = [
        Panel(
            f"stereo-window-{size}",
            _shown(maps[WINDOWS.index(size)]),
            f"`window={size}`: {shares['all'][WINDOWS.index(size)]:.1%} bad",
        )
        for size in SHOWN
    ]
    best = WINDOWS[int(np.argmin(shares["all"]))]
    return Figure(
        "How large a window?",
        "The oldest method compares windows. A small window keeps thin objects, and noise; a large "
        "one is smooth, and makes near objects wider. Surfaces need a large window, and rims a "
        f"small one: here {best} pixels are the best compromise, and ideal for neither.",
        "for window in (3, 11, 31):\n"
        "    costs = cvkern.stereo_cost(\n"
        '        left, right, (0, 64), cost="sad",\n'
        "        window=window, channel_axis=-1,\n"
        "    )\n"
        "    disparity = cvkern.winner_take_all(costs).disparity",
        (
            *panels,
            Panel(
                "stereo-window-plot",
                _picture(stereo_errors.plot(WINDOWS, shares)),
                "Share of bad pixels over the side of the window",
            ),
        ),
        clock.take(),
    )


def _errors(clock: Clock) -> Figure:
    left, right, truth = _pair()
    raw = cvkern.winner_take_all(
        cvkern.stereo_cost(left, right, DISPARITIES, cost="census", channel_axis=-1)
    ).disparity
    found = cvkern.stereo_match(left, right, DISPARITIES, channel_axis=-1).disparity
    hidden = stereo_errors.occluded(truth)
    plain = stereo_errors.flat(luma(left)) & ~hidden
    known = np.isfinite(truth)
    kinds = (
        ("occluded", hidden, HIDDEN),
        ("of low texture", plain & known, PLAIN),
        ("of the rest", known & ~hidden & ~plain, OTHER),
    )
    panels, lines = [], []
    for name, disparity, what in (
        ("raw", raw, "The best cost of each single pixel"),
        ("matched", found, "Semi-global, checked and filled"),
    ):
        wrong = stereo_errors.bad(disparity, truth)
        shown = np.repeat((0.45 * luma(left)).astype(np.uint8)[..., None], 3, axis=2)
        for _, kind, colour in kinds:
            shown = overlay_mask(shown, wrong & kind, color=colour)
        panels.append(Panel(f"stereo-errors-{name}", shown, f"{what}: {wrong.sum():,} bad pixels"))
        lines.append([f"{wrong[kind].mean():.0%} {text}" for text, kind, _ in kinds])
    return Figure(
        "Three ways to be wrong",
        "Orange: hidden from the right camera, so every match is wrong. Blue: hardly any texture, "
        "so everything matches. Red: the others. Bad pixels by the costs alone: "
        f"{', '.join(lines[0])}. Bad pixels in the end: {', '.join(lines[1])}.",
        "costs = cvkern.stereo_cost(\n"
        '    left, right, (0, 64), cost="census", channel_axis=-1,\n'
        ")\n"
        "raw = cvkern.winner_take_all(costs).disparity",
        tuple(panels),
        clock.take(),
    )


def _brightness(clock: Clock) -> Figure:
    left, right, truth = _pair()
    dim = np.round(DIMMED * right).astype(np.uint8)
    known = np.isfinite(truth)
    panels, shares = [Panel("stereo-dim", dim, f"The right photograph, at {DIMMED:.0%} light")], {}
    for cost in ("sad", "census"):
        for view in (right, dim):
            costs = cvkern.stereo_cost(
                left, view, DISPARITIES, cost=cost, window=9, channel_axis=-1
            )
            disparity = cvkern.winner_take_all(costs).disparity
            shares[cost, view is dim] = stereo_errors.bad(disparity, truth)[known].mean()
        label = f"`cost={cost!r}`: {shares[cost, True]:.0%} bad, {shares[cost, False]:.0%} before"
        panels.append(Panel(f"stereo-dim-{cost}", _shown(disparity), label))
    return Figure(
        "When one camera receives less light",
        "Two cameras rarely have equal brightness. Differences of grey levels then depend on the "
        "light, not on the scene. The census records only which neighbours are darker, and dimming "
        "changes this only by rounding.",
        'costs = cvkern.stereo_cost(\n    left, dim, (0, 64), cost="census",\n'
        "    window=9, channel_axis=-1,\n"
        ")\n"
        "disparity = cvkern.winner_take_all(costs).disparity",
        tuple(panels),
        clock.take(),
    )


def _shown(disparity: np.ndarray) -> np.ndarray:
    return apply_colormap(disparity, vmin=DISPARITIES[0], vmax=DISPARITIES[1] - 1, nan=(0, 0, 0))


def _picture(png: bytes) -> np.ndarray:
    import imageio.v3 as iio

    return np.ascontiguousarray(iio.imread(io.BytesIO(png), extension=".png")[..., :3])
