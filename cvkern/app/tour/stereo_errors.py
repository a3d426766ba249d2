"""Errors of stereo: kinds of pixels, found by ground truth, and the effect of the window."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

import cvkern

OFF = 1.0  # pixels: a disparity with a larger error is bad
RIM, JUMP = 9, 2.0  # side of the patch, and change of disparity in it, of a pixel near a rim
PATCH, TEXTURE = 9, 3.0  # side of the patch, and spread of grey levels in it, of a flat pixel


def bad(disparity: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Mark the pixels of known disparity whose found disparity is bad."""
    return np.isfinite(truth) & ~(np.abs(disparity - truth) <= OFF)


def occluded(truth: np.ndarray) -> np.ndarray:
    """Mark the pixels that the right camera does not see: outside its image, or occluded."""
    import scipy.ndimage as ndi

    height, width = truth.shape
    known = np.isfinite(truth)
    column = np.round(np.arange(width) - np.where(known, truth, 0)).astype(int)
    inside = known & (column >= 0) & (column < width)
    rows = np.broadcast_to(np.arange(height)[:, None], truth.shape)
    nearest = np.full(truth.shape, -np.inf)
    np.maximum.at(nearest, (rows[inside], column[inside]), truth[inside])
    nearest = ndi.maximum_filter1d(nearest, 3, axis=1)  # some surfaces fall on every second column
    hidden = np.zeros(truth.shape, bool)
    hidden[inside] = truth[inside] < nearest[rows[inside], column[inside]] - OFF
    return hidden | (known & ~inside)


def rims(truth: np.ndarray) -> np.ndarray:
    """Mark the pixels of known disparity near a jump in depth."""
    import scipy.ndimage as ndi

    known = np.isfinite(truth)
    high = ndi.maximum_filter(np.where(known, truth, -np.inf), RIM)
    low = ndi.minimum_filter(np.where(known, truth, np.inf), RIM)
    return known & (high - low > JUMP)


def flat(gray: np.ndarray) -> np.ndarray:
    """Mark the pixels whose patch has a small spread of grey levels, in [0, 255]."""
    mean = cvkern.box(gray, PATCH // 2)
    square = cvkern.box(np.square(gray, dtype=np.float32), PATCH // 2)
    return square - mean * mean < TEXTURE * TEXTURE


def sweep(
    left: np.ndarray,
    right: np.ndarray,
    truth: np.ndarray,
    disparities: tuple[int, int],
    windows: tuple[int, ...],
) -> tuple[list[np.ndarray], dict[str, list[float]]]:
    """Match by absolute differences in windows of several sizes.

    Returns
    -------
    list of array, dict
        The disparities for each window, and the share of bad pixels by kind: near rims, on flat
        surfaces, on textured surfaces, and of all pixels with known disparity. A kind without
        pixels is left out.
    """
    from cvkern.images.colors import luma

    axis = -1 if left.ndim == 3 else None
    rim, plain, known = rims(truth), flat(luma(left)), np.isfinite(truth)
    kinds = {
        "near rims": rim,
        "flat surfaces": known & plain & ~rim,
        "textured surfaces": known & ~plain & ~rim,
        "all": known,
    }
    kinds = {name: kind for name, kind in kinds.items() if kind.any()}
    maps, shares = [], {name: [] for name in kinds}
    for window in windows:
        costs = cvkern.stereo_cost(
            left, right, disparities, cost="sad", window=window, channel_axis=axis
        )
        disparity = cvkern.winner_take_all(costs, first=disparities[0]).disparity
        maps.append(disparity)
        wrong = bad(disparity, truth)
        for name, kind in kinds.items():
            shares[name].append(float(wrong[kind].mean()))
    return maps, shares


def plot(windows: tuple[int, ...], shares: dict[str, list[float]], kind: str = "png") -> bytes:
    """Draw the shares of :func:`sweep` over the windows, as a file of `kind`: png or svg."""
    import matplotlib
    from matplotlib.figure import Figure

    styles: dict[str, dict[str, Any]] = {
        "near rims": {"color": "#d97a1f"},
        "flat surfaces": {"color": "#7b3fa0"},
        "textured surfaces": {"color": "#2f6db3"},
        "all": {"color": "#5f6368", "linestyle": "--"},
    }
    # A fixed salt and no date: the same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "cvkern", "font.size": 11}):
        figure = Figure(figsize=(7.4, 5.0), dpi=100)
        panel = figure.subplots()
        for name, values in shares.items():
            percent = 100 * np.array(values)
            panel.plot(windows, percent, marker="o", markersize=4, label=name, **styles[name])
        panel.set_xlabel("edge of the window, pixels")
        panel.set_ylabel("bad pixels, %")
        panel.set_xticks(windows)
        panel.set_ylim(bottom=0)
        panel.grid(color="#e3e5e8", linewidth=0.6)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        panel.legend(frameon=False)
        figure.tight_layout()
        file = io.BytesIO()
        figure.savefig(file, format=kind, metadata={"Date": None} if kind == "svg" else None)
    return file.getvalue()
