"""Planes beside a HashField on photographs from one side, after equal times of training.

``python -m profiling.experiments.planes_quality FOLDER`` trains both on the library's own scene
and, where the data are, on two parts of instant-ngp's fox, and writes the quality of views that
were held out. FOLDER is that of ``CVKERN_DATA``.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from cvkern.radiance import PlanesField, Scene, evaluate, fit, load_scene, make_scene
from cvkern.radiance.training import suited
from profiling.experiments.radiance_quality import ROOT
from profiling.record import surroundings, write_json

PARTS = {"fox 0-8": (0, 9), "fox 31-39": (31, 40)}
SHRINK = 2  # the photographs of fox, to 240 x 135 pixels
HELD = slice(2, None, 4)  # frames that are held out of a part


def scenes(folder: Path | None) -> dict[str, Scene]:
    """Return the scenes by their names; fox only where the data are."""
    found = {"shapes-forward": make_scene(train=20, test=4, layout="forward")}
    if folder is None:
        return found
    whole = load_scene(folder / "nerf" / "fox").resized(SHRINK)
    for name, (first, last) in PARTS.items():
        test = np.zeros(last - first, bool)
        test[HELD] = True
        part = np.arange(first, last)
        images, cameras = whole.images[part], whole.cameras.select(part)
        found[name] = replace(whole, images=images, cameras=cameras, test=test)
    return found


def trained(scene: Scene, field: Any, seconds: float) -> dict[str, Any]:
    """Train a field and return its quality on the views that are held out."""
    model = fit(scene, field, seconds=seconds, progress=False)
    scores = evaluate(model, scene)
    return {
        "field": type(model.settings).__name__,
        "steps": model.training.step,
        "seconds": round(model.training.seconds, 1),
        "psnr": round(float(scores.psnr.mean()), 2),
        "ssim": round(float(scores.ssim.mean()), 4),
    }


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.planes_quality", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get("CVKERN_DATA"))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    args = parser.parse_args(command)
    results: dict[str, Any] = {}
    with cvkern.use(device=args.device):
        for name, scene in scenes(args.folder and Path(args.folder)).items():
            results[name] = []
            for field in (PlanesField(), suited("hash")):
                results[name].append(trained(scene, field, args.seconds))
                print(name, *(f"{k} {v}" for k, v in results[name][-1].items()), sep="  ")
    told = surroundings(args.device.partition(":")[0], [])
    told["command"] = "python -m profiling.experiments.planes_quality"
    name = f"planes_quality_{told['device']['kind']}.json"
    write_json(args.output / name, {**told, "results": results})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
