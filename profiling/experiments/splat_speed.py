"""How fast are many Gaussian splats? ``python -m profiling.experiments.splat_speed --device cuda``

Puts splats on spheres, as a trained scene has them on its surfaces, and times the parts of a
picture and of a step of training: on CUDA from graphs, so these are times of the device. Prints the
tiles that a splat meets, on which they depend.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import cvkern
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.radiance import CameraSet, Composited
from cvkern.kernels.codes.splats import Splats
from cvkern.radiance import SplatField, look_at
from cvkern.radiance.fields.field import Frame, Learning
from cvkern.radiance.rendering import owned
from cvkern.radiance.scenes.photographs import Bounds

SPHERES, EYE = 40, (0.3, -2.8, 0.4)
SIZE = -6.3  # mean logarithm of the standard deviations, for 10^6 splats; fewer are larger


def splats_on_spheres(count: int, rng: np.random.Generator) -> Splats:
    """Return splats of random sizes, turns and colours."""
    middles, radii = rng.uniform(-1, 1, (SPHERES, 3)), rng.uniform(0.1, 0.4, SPHERES)
    which, ways = rng.integers(0, SPHERES, count), rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    found = (
        middles[which] + radii[which, None] * ways,
        rng.normal(size=(count, 4)),
        rng.normal(SIZE - 0.5 * np.log(count / 1e6), 0.5, (count, 3)),
        rng.normal(0, 2, (count, 1)),
        rng.normal(0, 0.4, (count, 3)),
        rng.normal(0, 0.4, (count, 45)),
    )
    return Splats(*(a.astype(np.float32) for a in found))


def timed(rt: Runtime, call: Callable[[], Any], wait: Any, times: int) -> float:
    """Return the milliseconds of a call."""
    call()
    again = rt.record(call)
    again()
    rt.to_numpy(wait)
    begin = time.perf_counter()
    for _ in range(times):
        again()
    rt.to_numpy(wait)
    return 1e3 * (time.perf_counter() - begin) / times


def main(arguments: list[str] | None = None) -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--splats", type=int, default=10**6)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), help="width and height")
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args(arguments)
    width, height = args.size
    rng = np.random.default_rng(0)
    with cvkern.use(device=args.device):
        rt = runtime()
        frame = Frame(Bounds((0.0, 0.0, 0.0), 1.0, False), 0.1, 10.0)
        field = SplatField(args.splats).build(rt, frame, 0)
        field.become(splats_on_spheres(args.splats, rng))
        pose = look_at(np.array(EYE), np.zeros(3)).astype(np.float32)
        lens = np.array([[1.1 * width, 1.1 * width, width / 2, height / 2, 0, 0, 0, 0, 0]])
        field.begin(CameraSet(owned(rt, pose), owned(rt, lens.astype(np.float32)), width, height))
        area = width * height
        shapes = (area, 3), (area,), (area,), (1,)
        slopes = Composited(*(owned(rt, rng.normal(size=s).astype(np.float32)) for s in shapes))
        step, rays = rt.zeros((1,), np.int32), None
        learning = Learning(step, rt.zeros((1,)), 1e-9)
        parts: dict[str, Callable[[], Any]] = {
            "forward": lambda: field.forward(rays, step),  # pyright: ignore[reportArgumentType]
            "backward": lambda: field.backward(slopes),
            "learning": lambda: field.learn(learning),
        }
        field.forward(rays, step)  # pyright: ignore[reportArgumentType]
        seen = int((rt.to_numpy(field.screen.boxes)[:, 2] > 0).sum())
        print(f"{args.splats} splats, {seen} seen, {field.taken() / max(seen, 1):.2f} tiles each")
        for name, call in parts.items():
            print(f"{name:<10}{timed(rt, call, step, args.times):9.3f} ms", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
