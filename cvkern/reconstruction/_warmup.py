"""Calls that compile the kernels of reconstructions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.geometry.cameras.lens import Camera
from cvkern.reconstruction import adjust_bundle

# Families that they call compile theirs.
NO_KERNELS = ("read_reconstruction", "reconstruct", "write_reconstruction")


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function that has own kernels."""
    camera = Camera([[50, 0, 32], [0, 50, 24], [0, 0, 1]], shape=(48, 64))
    poses = np.stack([np.eye(3, 4)] * 2)
    poses[1, 0, 3] = 1
    points = np.array([[0.0, 0, 4], [1, 0, 5], [0, 1, 6]])
    tracks = np.array([(p, n) for p in range(3) for n in range(2)])
    places = np.full((6, 2), 30.0)
    call = partial(adjust_bundle, poses, camera, points, tracks, places, max_steps=1)
    yield "adjust_bundle", call
