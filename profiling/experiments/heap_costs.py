"""What a heap of photographs costs on 1, 10 and 100 machines: measured here, modelled beyond.

``python -m profiling.experiments.heap_costs`` writes photographs of 2 megapixels, applies a
function to them with each engine of :func:`cvkern.scale.map_images`, and prints a table.

Measured, for each engine: `file`, the seconds of one worker for one photograph, with all workers
busy; `start`, what is left for no photographs; and `task`, the seconds to hand out one file, from a
function that does nothing to small files.

The model of M machines with W workers each and n photographs of b bytes, on storage that gives B
bytes a second to all machines together:

    T(M) = start + max(n file / (M W), n task, n b / B) + file

Workers are busy all the time, or one process hands out files as fast as it can, or the storage is
the limit; the last file is waited for. Machines are like this one; their failures, and a storage
that is slower for many readers, are not in the model.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skimage.data

import cvkern
from cvkern.images import write_image
from cvkern.scale import map_images

MACHINES = 1, 10, 100


class Costs(NamedTuple):
    """The measured seconds of an engine."""

    start: float
    task: float
    file: float

    def of(self, machines: int, workers: int, files: int, size: int, rate: float) -> float:
        """Return the modelled seconds for a heap."""
        busy = files * self.file / (machines * workers)
        return self.start + max(busy, files * self.task, files * size / rate) + self.file


def nothing(image: np.ndarray) -> np.ndarray:
    """Do nothing that takes time."""
    return image[:1, :1]


def edges(image: np.ndarray) -> np.ndarray:
    """Find the edges of a photograph."""
    return cvkern.canny(image, 2.0, 0.8, 0.93, use_quantiles=True)


def timed(folder: Path, function: Any, engine: Any, workers: int) -> float:
    """Return the seconds of one call; results are written to a folder of their own."""
    with tempfile.TemporaryDirectory() as target:
        begin = time.perf_counter()
        report = map_images(folder, function, target, engine=engine, workers=workers)
        if report.failed:
            raise RuntimeError(str(next(iter(report.failed.items()))))
        return time.perf_counter() - begin


def line(folders: list[Path], function: Any, engine: str, workers: int) -> tuple[float, float]:
    """Return the seconds of no files, and of each one more, from a smaller and a larger folder."""
    few, many = (timed(folder, function, engine, workers) for folder in folders)
    first, last = (len(list(folder.iterdir())) for folder in folders)
    each = max((many - few) / (last - first), 0.0)
    return max(few - first * each, 0.0), each


def measured(engine: str, small: list[Path], photographs: list[Path], workers: int) -> Costs:
    """Measure an engine."""
    timed(photographs[0], edges, engine, workers)  # compiles
    _, task = line(small, nothing, engine, workers)
    start, each = line(photographs, edges, engine, workers)
    return Costs(start, task, each * workers)


def main() -> None:
    """Measure all engines, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--files", type=int, default=1_000_000, help="photographs of the heap")
    parser.add_argument("--rate", type=float, default=2.5e9, help="bytes a second of the storage")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--photographs", type=int, default=96, help="number that is measured")
    given = parser.parse_args()
    photo = np.tile(skimage.data.astronaut(), (3, 4, 1))[:1200, :1600]
    with tempfile.TemporaryDirectory() as scratch:

        def heap(number: int, image: np.ndarray) -> Path:
            folder = Path(scratch, f"{image.shape[0]}-{number}")
            folder.mkdir()
            for n in range(number):
                write_image(folder / f"{n:04d}.jpg", np.roll(image, 13 * n, axis=1))
            return folder

        small = [heap(number, photo[:8, :8]) for number in (50, 400)]
        photographs = [
            heap(number, photo) for number in (given.photographs // 4, given.photographs)
        ]
        sizes = [file.stat().st_size for file in photographs[1].iterdir()]
        size = int(np.mean(sizes))
        print(f"{given.files:,} photographs of {size / 1e6:.2f} MB, {given.workers} workers each")
        print("| engine | start | a task | a photograph | " + " | ".join(
            f"{m} machine{'s' * (m > 1)}" for m in MACHINES) + " |")  # fmt: skip
        print("|---" * (4 + len(MACHINES)) + "|")
        for engine in ("threads", "dask", "ray"):
            costs = measured(engine, small, photographs, given.workers)
            hours = [costs.of(m, given.workers, given.files, size, given.rate) / 3600
                     for m in (MACHINES if engine != "threads" else MACHINES[:1])]  # fmt: skip
            shown = [
                f"{h:.2f} h, {h * m:.1f} machine hours"
                for h, m in zip(hours, MACHINES, strict=False)
            ]
            shown += ["-"] * (len(MACHINES) - len(shown))
            start, task, file = costs
            print(f"| {engine} | {start:.1f} s | {1e3 * task:.2f} ms | {1e3 * file:.1f} ms | "
                  + " | ".join(shown) + " |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
