"""Stereo: disparity, depth, and where both go wrong."""

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
        "What is near moves more from one eye to the other. Find where each pixel of the left "
        "image lies in the right one, and its shift, the disparity, is its depth.",
        (_match, _cloud, _windows, _errors, _brightness),
    )


def _pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the motorcycle: left, right, and the disparity that was measured, NaN for none."""
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
        "A pixel alone fits in many places. Semi-global matching asks, along eight paths to each "
        "pixel, which disparity fits best with the fewest jumps on the way. Where the right camera "
        "sees nothing to match, the disparity comes from the background beside. "
        f"Against the ground truth, {share:.1%} of the pixels are off by more than one.",
        "found = cvkern.stereo_match(\n"
        "    left, right, disparities=(0, 64), channel_axis=-1,\n"
        ")\n"
        "found.disparity, found.valid, found.confidence",
        (
            Panel("stereo-left", left, "The left photograph, `skimage.data.stereo_motorcycle()`"),
            Panel("stereo-disparity", _shown(found.disparity), "Disparity: bright is near"),
            Panel("stereo-truth", _shown(truth), "Ground truth; black where there is none"),
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
        "Focal length and distance of the cameras turn disparity into metres, and each pixel into "
        f"a point: {len(cloud.points):,} of them, from {near:.1f} to {far:.1f} m away. Black are "
        "the pixels that only one camera saw, or where the two did not agree.",
        "q = cvkern.reprojection_matrix(\n"
        "    focal=994.978, baseline=193.001, doffs=31.086,\n"
        "    cx=311.193, cy=254.877,\n"
        ")\n"
        "cloud = cvkern.point_cloud(found.disparity, q, left, found.valid)\n"
        'write_animation("cloud.gif", turntable(*cloud))\n'
        'write_ply("cloud.ply", *cloud)',
        (
            Panel("stereo-cloud", movie, "The points, from a camera that swings about them"),
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
        "The oldest method compares windows. A small one keeps thin things and drowns in noise; a "
        "large one is smooth, and fattens whatever is in front. Surfaces want a large one and rims "
        f"a small one: here the best compromise is {best} pixels, and right for neither.",
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
                "Bad pixels over the edge of the window",
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
        ("raw", raw, "Costs alone, the best of each pixel"),
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
        "Orange: hidden from the right camera, so that any match is a wrong one. Blue: hardly any "
        "texture, so that everything fits. Red: the rest. Bad of the costs alone: "
        f"{', '.join(lines[0])}. Bad in the end: {', '.join(lines[1])}.",
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
        "When one camera sees less light",
        "Two cameras rarely agree on brightness. Differences of grey levels then compare the "
        "lamps, not the things. The census asks only which neighbours are darker, and dimming "
        "changes that only by rounding.",
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
