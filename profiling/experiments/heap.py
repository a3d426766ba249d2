"""How long does a heap take? ``python -m profiling.experiments.heap [--device cuda]``

Renders three rings of 30 photographs and ten strangers, 2 megapixels each, in no order, and makes
their panoramas, about 60 megapixels together: no file is read. Prints the seconds of a second call,
step by step, how far the angles between neighbours are from those of the cameras, and whether the
groups are right. With --json, writes what it measured.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import cvkern
from profiling.arrays import carrier, load
from profiling.clock import clock
from profiling.record import surroundings, write_json

SHAPE = 1250, 1600  # rows, columns of a photograph
FOCAL = 1.2  # widths of a photograph
SIGMAS = 1.5, 4.0, 12.0  # blobs of a scene
LIMIT = 0.2  # degrees that an angle between neighbours may be off
CALLS = 3


def scene(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Return a coloured picture of blobs of three sizes, which wraps at its ends, uint8."""
    border = int(4 * SIGMAS[-1])
    total = np.zeros((*shape, 3), np.float32)
    for sigma in SIGMAS:
        layer = rng.standard_normal((*shape, 3), np.float32)
        wide = cv2.copyMakeBorder(layer, 0, 0, border, border, cv2.BORDER_WRAP)
        smooth = cv2.GaussianBlur(wide, (0, 0), sigma)[:, border:-border]
        total += smooth / smooth.std()
    return np.clip(128 + 28 * total, 0, 255).astype(np.uint8)


def ring(
    count: int, shape: tuple[int, int], rng: np.random.Generator
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return photographs all round a cylinder, and the rotations (count, 3, 3) of the cameras."""
    height, width = shape
    focal = FOCAL * width
    picture = scene((round(1.3 * height), round(2 * np.pi * focal)), rng)
    wide = cv2.copyMakeBorder(picture, 0, 0, 0, 2, cv2.BORDER_WRAP)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    rays = np.stack(
        ((x - (width - 1) / 2) / focal, (y - (height - 1) / 2) / focal, np.ones_like(x))
    )
    photos, rotations = [], []
    for k in range(count):
        a, b = 2 * np.pi * k / count, np.radians(rng.normal(0, 1))
        yaw = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
        pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        rotations.append(pitch @ yaw)
        world = np.einsum("ji,jhw->ihw", rotations[-1].astype(np.float32), rays)
        rows = world[1] / np.hypot(world[0], world[2]) * focal + (len(picture) - 1) / 2
        columns = np.arctan2(world[0], world[2]) * focal % picture.shape[1]
        photos.append(cv2.remap(wide, columns, rows, cv2.INTER_LINEAR))
    return photos, np.stack(rotations)


def angles(rotations: np.ndarray) -> np.ndarray:
    """Return the angles between neighbours on a ring, degrees."""
    across = np.roll(rotations, -1, axis=0) @ rotations.swapaxes(1, 2)
    traces = np.trace(across, axis1=1, axis2=2)
    return np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rings", type=int, default=3)
    parser.add_argument("--views", type=int, default=30, help="photographs of a ring")
    parser.add_argument("--strangers", type=int, default=10)
    parser.add_argument("--scale", type=float, default=1.0, help="of the sides of a photograph")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(command)
    rng = np.random.default_rng(0)
    shape = round(SHAPE[0] * args.scale), round(SHAPE[1] * args.scale)
    rings = [ring(args.views, shape, rng) for _ in range(args.rings)]
    heap = [photo for photos, _ in rings for photo in photos]
    heap += [scene(shape, rng) for _ in range(args.strangers)]
    order = rng.permutation(len(heap))
    library = carrier() if args.device == "cuda" else "numpy"
    images = [load(heap[i], library, args.device) for i in order]
    with cvkern.use(device=args.device):
        timer = clock(args.device)
        runs = [timed(images, timer) for _ in range(1 + CALLS)]
    made, first = runs[0]
    took = [sum(seconds.values()) for _, seconds in runs[1:]]
    best = runs[1 + int(np.argsort(took)[len(took) // 2])][1]
    wanted = [set(range(k * args.views, (k + 1) * args.views)) for k in range(args.rings)]
    off, right = 0.0, len(made) == args.rings
    for one in made:
        members = order[one.members]
        right &= set(members.tolist()) in wanted and one.closed
        if right:
            truth = rings[members.min() // args.views][1]
            found = angles(np.asarray(one.rotations)[np.argsort(members)])
            off = max(off, float(np.abs(found - angles(truth)).max()))
    pixels = sum(one.image.shape[0] * one.image.shape[1] for one in made)
    print(f"{len(heap)} photographs of {shape[0] * shape[1] / 1e6:.1f} MP, arrays of {library}")
    print(f"panoramas right: {right}, {pixels / 1e6:.1f} MP, angles off by {off:.3f} degrees")
    print(f"first call {sum(first.values()):.2f} s, median of {CALLS} more {np.median(took):.3f} s")
    for name, seconds in best.items():
        print(f"  {name:16} {seconds:.3f} s")
    result = {
        "photographs": len(heap), "shape": list(shape), "pixels": int(pixels), "right": bool(right),
        "degrees_off": off, "first_s": sum(first.values()), "seconds": took, "steps_s": best,
        "arrays": library,
    }  # fmt: skip
    if args.json:
        whole = surroundings(args.device, sys.argv[1:] if command is None else command)
        write_json(args.json, whole | result)
    return 0 if right and off <= LIMIT else 1


def timed(images: list[Any], timer: Any) -> tuple[list[Any], dict[str, float]]:
    """Return the panoramas, and the seconds of each step."""
    steps: dict[str, float] = {}
    now, begin = "preparation", time.perf_counter()

    def said(done: int, total: int, text: str) -> None:
        nonlocal now, begin
        timer.synchronize()
        steps[now] = steps.get(now, 0.0) + time.perf_counter() - begin
        now, begin = text.partition(" ")[0], time.perf_counter()

    made = cvkern.stitch(images, progress=said)
    said(0, 0, "")
    return made, steps


if __name__ == "__main__":
    raise SystemExit(main())
