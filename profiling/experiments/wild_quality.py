"""Photographs of changing light and with occluders, made from lego as in NeRF-W's supplement.

``python -m profiling.experiments.wild_quality FOLDER`` changes the training photographs, trains
with and without a model of their light and of what passes, and writes the quality of the clean
views that were held out. FOLDER is that of ``CVKERN_DATA``.

Photograph 0 stays clean. For every other one, the colours c become clip(s c + b), with s from 0.8
to 1.2 and b from -0.2 to 0.2 for each channel, before they are composited. The occluder is a square
of a quarter of the photograph's side, of 10 upright stripes of random colours, whose upper left
corner is between a quarter and a half of the side.

The way "trimmed" weighs pixels by `_trimmed.Trimmed` instead of the rule of ``robust=True``. Each
result has the quality after one affine map of the colours of all views as well: what it gains is
the uncertainty of the light of photograph 0.
"""

from __future__ import annotations

import argparse
import itertools
import os
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import cvkern
from cvkern.radiance import Model, Scene, evaluate, fit, load_scene, psnr, render, trainer
from cvkern.radiance.rendering import photograph
from cvkern.radiance.training import KINDS, suited
from profiling.experiments._trimmed import Trimmed
from profiling.record import ROOT, surroundings, write_json

CHANGES = ("clean", "color", "occluder", "both")
STRIPES = 10
LIGHT: dict[str, Any] = {"appearance": "affine"}
WAYS: dict[str, tuple[dict[str, Any], ...]] = {
    "clean": ({}, LIGHT, {"robust": True}, {"transient": True}, {"trimmed": True}),
    "color": ({}, LIGHT, {"appearance": "embedding"}),
    "occluder": ({}, {"robust": True}, {"transient": True}, {"trimmed": True}),
    "both": ({}, LIGHT, LIGHT | {"robust": True}, LIGHT | {"transient": True}),
}


def changed(scene: Scene, change: str, seed: int = 0) -> Scene:
    """Return the scene with changed training photographs; those held out stay clean."""
    if change == "clean":
        return scene
    images = scene.images.copy()
    for number, view in enumerate(np.flatnonzero(~scene.test)[1:].tolist(), 1):
        rng, image = np.random.default_rng((seed, number)), images[view]
        scale, shift = rng.uniform(0.8, 1.2, 3), rng.uniform(-0.2, 0.2, 3)
        if change in ("color", "both"):
            colors = scale * (image[..., :3] / 255) + shift
            image[..., :3] = np.round(255 * colors.clip(0, 1))
        if change in ("occluder", "both"):
            side = image.shape[1] // 4
            top, left = rng.integers(side, 2 * side, 2)
            edges = left + np.round(np.linspace(0, side, STRIPES + 1)).astype(int)
            for begin, end in itertools.pairwise(edges):
                stripe = image[top : top + side, begin:end]
                stripe[..., :3], stripe[..., 3:] = rng.integers(0, 256, 3), 255
    return replace(scene, images=images)


def trained(scene: Scene, field: Any, seconds: float, options: dict[str, Any]) -> dict[str, Any]:
    """Train, and return the quality of the views that are held out."""
    given, rule = dict(options), trainer.Distractors
    if given.pop("trimmed", False):
        given["robust"], rule = True, Trimmed
    with mock.patch.object(trainer, "Distractors", rule):
        model = fit(scene, field, seconds=seconds, progress=False, **given)
    scores = evaluate(model, scene)
    return {
        **options,
        "steps": model.training.step,
        "seconds": round(model.training.seconds, 1),
        "psnr": round(float(scores.psnr.mean()), 2),
        "psnr_mapped": round(mapped(model, scene), 2),
        "ssim": round(float(scores.ssim.mean()), 4),
    }


def mapped(model: Model, scene: Scene) -> float:
    """Return the quality after the one affine map of colours that makes it best."""
    views = np.flatnonzero(scene.test).tolist()
    found, truth = (
        np.stack([draw(view) for view in views]).astype(np.float64)
        for draw in (
            lambda view: render(model, scene.cameras, view).color,
            lambda view: photograph(scene, view, model.behind),
        )
    )
    shown = (found != model.behind).any(axis=-1)
    system = np.column_stack((found[shown], np.ones(shown.sum())))
    change, *_ = np.linalg.lstsq(system, truth[shown], rcond=None)
    found[shown] = system @ change
    return float(np.mean([psnr(a, b) for a, b in zip(found, truth, strict=True)]))


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.wild_quality", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get("CVKERN_DATA"))
    parser.add_argument("--scene", default="lego")
    parser.add_argument("--changes", nargs="+", choices=CHANGES, default=list(CHANGES))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--shrink", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0, help="of the changes")
    parser.add_argument("--field", choices=tuple(KINDS), help="of a size for the device")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    args = parser.parse_args(command)
    results: dict[str, Any] = {}
    with cvkern.use(device=args.device):
        settings = suited(args.field)
        clean = load_scene(Path(args.folder) / "nerf" / args.scene)
        for change in args.changes:
            scene = changed(clean, change, args.seed)
            scene = scene if args.shrink == 1 else scene.resized(args.shrink)
            results[change] = []
            for options in WAYS[change]:
                results[change].append(trained(scene, settings, args.seconds, options))
                print(change, *(f"{k} {v}" for k, v in results[change][-1].items()), sep="  ")
    told = surroundings(args.device.partition(":")[0], [])
    told["command"] = "python -m profiling.experiments.wild_quality"
    told |= {"scene": args.scene, "shrink": args.shrink, "seed": args.seed}
    told["field"] = type(settings).__name__
    name = f"wild_quality_{args.scene}_{told['device']['kind']}.json"
    write_json(args.output / name, {**told, "results": results})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
