"""Canny's edges in tiles, killed again and again at random moments, and resumed to equal bits.

``python -m profiling.experiments.kills`` kills a run 20 times by SIGKILL, each time after a few
more tiles and a random part of a second, and compares what the last run leaves with the edges of
the whole image.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from cvkern.scale import apply

SIDE, TILE = 7200, 160
OPTIONS: dict[str, Any] = {"sigma": 1.5, "low_threshold": 4.0, "high_threshold": 60.0}


def child(folder: Path) -> None:
    """Compute what is left, and say when a tile is finished."""
    source = np.load(folder / "source.npy", mmap_mode="r")
    target = np.lib.format.open_memmap(folder / "target.npy", "r+")
    apply(
        "canny", source, target, tile=TILE, journal=folder / "journal",
        progress=lambda done, _: print(done, flush=True), **OPTIONS,
    )  # fmt: skip


def main() -> None:
    """Kill, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.child)
        return
    draw = random.Random(given.seed)
    noise = np.random.default_rng(given.seed).integers(0, 256, (SIDE, SIDE), np.uint8)
    image = cvkern.gaussian(noise, 2)
    image = ((image - image.mean()) * 8 + 128).clip(0, 255).astype(np.uint8)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.save(folder / "source.npy", image)
        np.save(folder / "target.npy", np.zeros(image.shape, bool))
        words = [sys.executable, "-m", __spec__.name, "--child", name]
        for kill in range(given.kills):
            run = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
            assert run.stdout
            for _ in range(draw.randint(1, 9)):
                if not run.stdout.readline():
                    raise RuntimeError(f"the run ended before kill {kill}")
            time.sleep(draw.random() / 20)
            os.kill(run.pid, signal.SIGKILL)
            run.wait()
            kept = len(list((folder / "journal").glob("*.npz")))
            print(f"kill {kill + 1}: {kept} of {(SIDE // TILE) ** 2} tiles are kept", flush=True)
        subprocess.run(words, check=True, capture_output=True)
        found = np.load(folder / "target.npy")
        assert not (folder / "journal").exists()
    want = cvkern.canny(image, **OPTIONS)
    assert want.any()
    np.testing.assert_array_equal(found, want)
    print(f"{given.kills} kills: equal bits")


if __name__ == "__main__":
    main()
