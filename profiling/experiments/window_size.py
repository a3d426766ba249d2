"""How large should a stereo window be? ``python -m profiling.experiments.window_size [FOLDER]``

Small windows keep detail and noise, large ones are smooth and fatten rims: prints the share of bad
pixels of each, by kind of pixel, and writes profiling/results/window_size.json and .svg. Without
FOLDER (or CVKERN_DATA), which holds a folder for each pair under ``stereo``, the pair is
scikit-image's motorcycle.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cvkern.app.tour.stereo_errors import plot, sweep
from cvkern.images import read_image
from profiling.record import ROOT, write_json, write_text

WINDOWS = (3, 5, 7, 9, 11, 15, 21, 31, 41)
Pair = tuple[str, np.ndarray, np.ndarray, np.ndarray, int]  # name, left, right, truth, disparities


def pairs(folder: Path | None) -> Iterator[Pair]:
    """Yield the pairs under `folder`, or the motorcycle."""
    if folder is None:
        from skimage import data

        yield "motorcycle", *data.stereo_motorcycle(), 64
        return
    for place in sorted(path.parent for path in folder.glob("stereo/*/meta.json")):
        with np.load(place / "disparity.npz") as file:
            truth = file["disparity"]
        count = json.loads((place / "meta.json").read_text(encoding="utf-8"))["ndisp"]
        left, right = (read_image(place / f"{side}.png") for side in ("left", "right"))
        yield place.name, left, right, truth, int(count)


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.window_size", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get("CVKERN_DATA"))
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    parser.add_argument("--window", type=int, nargs="+", default=list(WINDOWS))
    args = parser.parse_args(command)

    windows, found = tuple(args.window), {}
    for name, left, right, truth, count in pairs(args.folder and Path(args.folder)):
        _, shares = sweep(left, right, truth, (0, count), windows)
        found[name] = shares
        print(f"{name}, bad pixels in % by the edge of the window")
        print(f"{'':18}", *(f"{size:>5}" for size in windows))
        for kind, values in shares.items():
            print(f"{kind:18}", *(f"{100 * value:5.1f}" for value in values))
    if not found:
        print(f"folder must hold pairs under stereo, got {args.folder}", file=sys.stderr)
        return 2
    kinds = dict.fromkeys(kind for shares in found.values() for kind in shares)
    mean = {
        kind: np.mean([s[kind] for s in found.values() if kind in s], axis=0).tolist()
        for kind in kinds
    }
    result = {"windows": list(windows), "cost": "sad", "pairs": found, "mean": mean}
    write_json(args.output / "window_size.json", result)
    write_text(args.output / "window_size.svg", plot(windows, mean, "svg").decode("utf-8"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
