"""How good are the disparities? ``python -m profiling.experiments.stereo_quality [FOLDER]``

Prints the share of bad pixels of stereo_match, with one set of options, beside that of OpenCV's
StereoSGBM with its gaps filled in the same way, and writes profiling/results/stereo_quality.json.
Again for pairs that are harder: at half size, with one image darker, and with noise. Without FOLDER
(or CVKERN_DATA), which holds a folder for each pair under ``stereo``, the pair is scikit-image's
motorcycle.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

import cvkern
from cvkern.app.tour.stereo_errors import occluded
from profiling.record import ROOT, surroundings, write_json

from .window_size import Pair, pairs

Matcher = Callable[[np.ndarray, np.ndarray, int], np.ndarray]

NOISE = 6.0  # standard deviation, of 255
CONTRAST, GAMMA = 0.93, 1.15  # what makes the darker image


def ours(**options: object) -> Matcher:
    """Match with these options of stereo_match, and the defaults of all others."""

    def match(left: np.ndarray, right: np.ndarray, count: int) -> np.ndarray:
        axis = -1 if left.ndim == 3 else None
        return cvkern.stereo_match(left, right, (0, count), channel_axis=axis, **options).disparity  # pyright: ignore[reportArgumentType]

    return match


def opencv(left: np.ndarray, right: np.ndarray, count: int) -> np.ndarray:
    """Match by StereoSGBM, in the mode of all eight paths, and fill from the background."""
    mode = cv2.STEREO_SGBM_MODE_HH
    size = -(-count // 16) * 16
    matcher = cv2.StereoSGBM.create(0, size, 3, 216, 864, 1, 0, 10, 100, 2, mode)
    margin = ((0, 0), (size, 0), *[(0, 0)] * (left.ndim - 2))  # it leaves out as many columns
    wide = (np.pad(image, margin, "edge") for image in (left, right))
    found = matcher.compute(*wide)[:, size:] / 16.0
    return cvkern.fill_disparity(np.where(found < 0, np.nan, found))


MATCHERS: dict[str, Matcher] = {
    "8 paths": ours(),
    "4 paths": ours(paths=4),
    "8 paths, unrefined": ours(speckle_size=0, smoothing=0),
    "window 7": ours(method="window", window=7),
    "window 11": ours(method="window", window=11),
    "window 21": ours(method="window", window=21),
    "OpenCV SGBM": opencv,
}


def given(pair: Pair) -> Pair:
    """Return the pair as it is."""
    return pair


def halved(pair: Pair) -> Pair:
    """Return the pair at half its size."""
    name, left, right, truth, count = pair
    height, width = (n // 2 * 2 for n in truth.shape)
    one, other = (
        cv2.resize(image[:height, :width], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        for image in (left, right)
    )
    return name, one, other, truth[:height:2, :width:2] / 2, count // 2 + 1


def darkened(pair: Pair) -> Pair:
    """Return the pair with a right image of another exposure."""
    name, left, right, truth, count = pair
    darker = 255 * CONTRAST * (right / 255.0) ** GAMMA
    return name, left, darker.round().astype(np.uint8), truth, count


def noisy(pair: Pair) -> Pair:
    """Return the pair with noise in both images."""
    name, left, right, truth, count = pair
    rng = np.random.default_rng(0)
    one, other = (
        (image + rng.normal(0, NOISE, image.shape)).clip(0, 255).round().astype(np.uint8)
        for image in (left, right)
    )
    return name, one, other, truth, count


VERSIONS = {"as given": given, "half size": halved, "one darker": darkened, "with noise": noisy}


def scores(disparity: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return shares of bad pixels, in %, and the median error, in pixels."""
    known = np.isfinite(truth)
    seen = known & ~occluded(truth)
    error = np.abs(disparity - truth, where=known, out=np.zeros(truth.shape))

    def bad(most: float, where: np.ndarray) -> float:
        return round(100 * float((error > most)[where].mean()), 2)

    return {
        "bad-1": bad(1, known),
        "bad-1 seen by both": bad(1, seen),
        "bad-2": bad(2, known),
        "bad-4": bad(4, known),
        "median": round(float(np.median(error[known])), 3),
    }


def table(title: str, found: dict[str, dict[str, dict[str, float]]], score: str) -> str:
    """Return one score of all matchers and pairs, and the mean over the pairs."""
    names = list(next(iter(found.values())))
    lines = [title, f"{'':20}" + "".join(f"{n[:10]:>11}" for n in [*names, "mean"])]
    for matcher, by_pair in found.items():
        values = [by_pair[name][score] for name in names]
        cells = "".join(f"{v:11.1f}" for v in [*values, np.mean(values)])
        lines.append(f"{matcher:20}{cells}")
    return "\n".join(lines)


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.stereo_quality", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get("CVKERN_DATA"))
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    args = parser.parse_args(command)

    results = {}
    for version, change in VERSIONS.items():
        found: dict[str, dict[str, dict[str, float]]] = {name: {} for name in MATCHERS}
        for pair in pairs(args.folder and Path(args.folder)):
            name, left, right, truth, count = change(pair)
            for matcher, match in MATCHERS.items():
                found[matcher][name] = scores(match(left, right, count), truth)
        if not found["8 paths"]:
            print(f"folder must hold pairs under stereo, got {args.folder}", file=sys.stderr)
            return 2
        for score in ("bad-1", "bad-1 seen by both") if version == "as given" else ("bad-1",):
            print(table(f"{version}: {score}, %", found, score), end="\n\n")
        results[version] = found
    told = surroundings("cpu", [])
    told["command"] = "python -m profiling.experiments.stereo_quality"
    write_json(args.output / "stereo_quality.json", {**told, "results": results})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
