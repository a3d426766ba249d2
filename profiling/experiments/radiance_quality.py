"""How good are radiance fields after how long? ``python -m profiling.experiments.radiance_quality``

Trains a HashField, or another field, on posed photographs, anew for each time on the training
clock, and judges it by the held-out views. FOLDER (or CVKERN_DATA) holds a folder for
each scene under ``nerf``; without it the scene is the library's own. Prints a table and writes
profiling/results/radiance_quality_FIELD_DEVICE.json.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from cvkern.radiance import Scene, fit, load_scene, make_scene, render
from cvkern.radiance.training import KINDS, suited
from profiling.record import ROOT, surroundings, write_json

VIEW = 800  # edge of the picture that is timed, in pixels
REPEATS = 9


def trained(scene: Scene, settings: Any, seconds: float) -> tuple[dict[str, Any], Any]:
    """Train for so long; return what came of it, and the model."""
    model = fit(scene, settings, seconds=seconds, progress=False)
    training = model.training
    mark = training.marks[-1]
    return {
        "seconds": round(training.seconds, 2),
        "steps": training.step,
        "psnr": round(mark.test_psnr, 2),
        "ssim": round(mark.test_ssim, 4),
        "rays_per_second": round(training.total_rays / training.seconds),
        "samples_per_second": round(training.total_samples / training.seconds),
    }, model


def view_time(model: Any) -> float:
    """Return the median time, ms, of rendering a view of 800 pixels, and having it as NumPy's."""
    cameras = model.cameras.scaled(VIEW / model.cameras.width)
    times = []
    for i in range(REPEATS + 1):
        begin = time.perf_counter()
        render(model, cameras, i % len(cameras))
        times.append(time.perf_counter() - begin)
    return round(1e3 * float(np.median(times[1:])), 2)


def scenes(folder: Path | None, names: list[str], shrink: int) -> dict[str, Scene]:
    """Return the scenes of these names, their photographs averaged over blocks."""
    if folder is None:
        return {"shapes": make_scene()}
    found = {name: load_scene(folder / "nerf" / name) for name in names}
    return {name: s if shrink == 1 else s.resized(shrink) for name, s in found.items()}


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.radiance_quality", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get("CVKERN_DATA"))
    parser.add_argument("--scenes", nargs="+", default=["lego", "chair", "fox"])
    parser.add_argument("--seconds", nargs="+", type=float, default=[5.0, 10.0, 20.0, 60.0])
    parser.add_argument("--shrink", type=int, default=1)
    parser.add_argument("--field", choices=tuple(KINDS), help="of a size for the device")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    args = parser.parse_args(command)

    results: dict[str, Any] = {}
    with cvkern.use(device=args.device):
        settings = suited(args.field)
        folder = args.folder and Path(args.folder)
        for name, scene in scenes(folder, args.scenes, args.shrink).items():
            begin = time.perf_counter()
            fit(scene, settings, steps=1, progress=False)  # compiles what is not compiled yet
            results[name] = {"first_step": round(time.perf_counter() - begin, 1), "times": []}
            model = None
            for seconds in args.seconds:
                row, model = trained(scene, settings, seconds)
                results[name]["times"].append(row)
                print(name, *(f"{k} {v:,}" for k, v in row.items()), sep="  ", flush=True)
            results[name]["view_ms"] = view_time(model)
            print(name, f"a view of {VIEW} pixels a side: {results[name]['view_ms']} ms")
    told = surroundings(args.device.partition(":")[0], [])
    told["command"] = "python -m profiling.experiments.radiance_quality"
    told["field"] = {type(settings).__name__: asdict(settings)}
    told["shrink"] = args.shrink
    name = f"radiance_quality_{type(settings).__name__}_{told['device']['kind']}.json"
    write_json(args.output / name, {**told, "results": results})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
