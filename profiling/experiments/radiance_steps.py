"""Where does a training step go? ``python -m profiling.experiments.radiance_steps``

Trains a field on the library's own scene, or on the one in SCENE. Then it times each primitive of
one more step by itself, and adds up those of the forward and of the backward pass. A row has the
bytes that a primitive streams (its arrays of rays, samples and parameters, once each), the bytes
that it gathers or scatters (eight corners of each sample's cells), and the rate of both together as
a share of the rate of a plain copy. This share is above 100 % where caches hold a table. Writes
profiling/results/radiance_steps_FIELD_DEVICE.json. ``--deterministic`` measures training that is
equal from run to run on a GPU, for radiance_steps_FIELD_deterministic_DEVICE.json.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import cvkern
from cvkern.radiance import fit, load_scene, make_scene
from cvkern.radiance.trainer import Trainer
from cvkern.radiance.training import KINDS, suited
from profiling import clock
from profiling.record import ROOT, surroundings, write_json

Call = tuple[str, Callable[..., object], tuple[Any, ...]]  # its name, itself, its arguments

STEPS_TIMED = 30
AHEAD = 8  # steps that a GPU is given before the one that is timed


class Listener:
    """A folder or a module of primitives that notes its calls, by their place in it."""

    def __init__(self, place: str, inner: Any, calls: list[Call]):
        self._place, self._inner, self._calls = place, inner, calls

    def __getattr__(self, name: str) -> Any:
        found: Any = getattr(self._inner, name)
        place = f"{self._place}{name}"
        if not callable(found):
            return Listener(f"{place}.", found, self._calls)

        def call(*arguments: Any) -> None:
            self._calls.append((place, found, arguments))
            found(*arguments)

        return call


def calls_of(trainer: Trainer) -> list[Call]:
    """Take a step, and return its calls of primitives."""
    rt, calls = trainer.rt, []
    trainer.step()
    folder = rt.radiance
    try:
        setattr(rt, "radiance", Listener("", folder, calls))  # noqa: B010  (of another type)
        trainer.step()
    finally:
        setattr(rt, "radiance", folder)  # noqa: B010
    return calls


def timed(trainer: Trainer) -> tuple[list[Call], list[float]]:
    """Return the calls of a step, and the median time that each takes in it, in microseconds."""
    trainer.repeat()
    trainer.repeat()
    calls, times = calls_of(trainer), []
    for _ in range(STEPS_TIMED):
        if trainer.rt.device == "cpu":  # a call is done when it returns
            marks = [time.perf_counter()]
            for _, primitive, arguments in calls:
                primitive(*arguments)
                marks.append(time.perf_counter())
            times.append(1e6 * np.diff(marks))
            continue
        for _ in range(AHEAD):  # the host gets ahead, so that only the device's time counts
            trainer.repeat()
        stream = wp.get_stream()
        events = [stream.record_event(wp.Event(enable_timing=True))]
        for _, primitive, arguments in calls:
            primitive(*arguments)
            events.append(stream.record_event(wp.Event(enable_timing=True)))
        wp.synchronize_stream(stream)
        times.append([1e3 * wp.get_event_elapsed_time(a, b) for a, b in itertools.pairwise(events)])
    return calls, np.median(times, axis=0).tolist()


def corners(trainer: Trainer, name: str) -> int:
    """Return the bytes that a primitive gathers or scatters for each sample."""
    field: Any = trainer.field
    if name in ("fields.hash.encode", "fields.hash.backward"):
        table = field.table.sums if name == "fields.hash.backward" else field.table.copy
        return 8 * field.settings.levels * 2 * size_of(table)
    if name in ("fields.voxel.rays.render", "fields.voxel.rays.render_backward"):
        added = 2 * size_of(field._sums[1]) if name == "fields.voxel.rays.render_backward" else 0
        return 8 * (4 + added) * (1 + field.color.shape[3])  # read; and added to
    return 0


def streamed(trainer: Trainer, call: Call, samples: int) -> int:
    """Return the bytes of a call's arrays, once each, of as many rows as are in use."""
    name, _, arguments = call
    room = getattr(trainer.field, "room", None)
    rows = {trainer.field.rays: trainer.model.training.rays, room: samples}
    total = 0
    for array in {id(a): a for a in arguments if hasattr(a, "shape")}.values():
        # Not of what is gathered from, or of grids of which few nodes are touched.
        sparse = corners(trainer, name) or name.startswith(("fields.voxel.", "pinhole."))
        whole = 0 if sparse else array.shape[0]
        total += rows.get(array.shape[0], whole) * math.prod(array.shape[1:]) * size_of(array)
    return total


def size_of(array: Any) -> int:
    """Return the bytes of an item."""
    return array.nbytes // array.size if isinstance(array, np.ndarray) else array.strides[-1]


def part_of(name: str) -> str:
    """Return which third of a step a primitive is in."""
    if "backward" in name or name in ("training.adam.collect", "training.background.gather"):
        return "backward"
    learning = name.startswith(("training.adam.", "fields.voxel.nodes."))
    return "learning" if learning else "forward"


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m profiling.experiments.radiance_steps", description=__doc__
    )
    parser.add_argument("scene", type=Path, nargs="?")
    parser.add_argument("--field", choices=tuple(KINDS), help="of a size for the device")
    parser.add_argument("--steps", type=int, default=2000, help="to train for before")
    parser.add_argument("--deterministic", action="store_true", help="with sums of integers")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", type=Path, default=ROOT / "profiling" / "results")
    args = parser.parse_args(command)

    with cvkern.use(device=args.device):
        scene = load_scene(args.scene) if args.scene else make_scene()
        settings = suited(args.field)
        model = fit(
            scene, settings, steps=args.steps, deterministic=args.deterministic, progress=False
        )
        trainer = Trainer(model, scene, "squared", 0.0)
        copy = clock.copy_bandwidth(clock.clock(args.device), clock.COPY_BYTES)
        calls, times = timed(trainer)
        trainer.keep()  # how many rays fit
        samples = trainer.field.taken()
    rows: list[dict[str, Any]] = []
    sums: dict[str, float] = dict.fromkeys(("forward", "backward", "learning"), 0.0)
    for call, us in zip(calls, times, strict=True):
        name = call[0]
        stream, gathered = streamed(trainer, call, samples), corners(trainer, name) * samples
        share = (stream + gathered) / (1e-6 * us * copy)
        sums[part_of(name)] += us
        rows.append(
            {
                "primitive": name,
                "us": round(us, 1),
                "streamed_mb": round(stream / 1e6, 1),
                "gathered_mb": round(gathered / 1e6, 1),
                "of_copy": round(share, 3),
            }
        )
        print(
            f"{name:28}{us:10.1f} us{stream / 1e6:9.1f} MB{gathered / 1e6:9.1f} MB"
            f"{100 * share:7.0f} %"
        )
    step = sum(sums.values())
    print(f"{samples:,} samples of {model.training.rays:,} rays, {samples / step:.1f} M samples/s")
    print(", ".join(f"{part} {us:.0f} us" for part, us in sums.items()))
    told = surroundings(args.device.partition(":")[0], [])
    told["command"] = "python -m profiling.experiments.radiance_steps"
    told |= {"field": type(settings).__name__, "copy_gb_per_s": round(copy / 1e9, 1)}
    told["deterministic"] = args.deterministic
    told |= {"samples": samples, "rays": model.training.rays}
    told |= {"parts_us": {part: round(us, 1) for part, us in sums.items()}, "primitives": rows}
    kind = "deterministic_" * args.deterministic + told["device"]["kind"]
    write_json(args.output / f"radiance_steps_{told['field']}_{kind}.json", told)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
