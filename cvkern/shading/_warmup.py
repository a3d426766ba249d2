"""Calls that compile the kernels of shading."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.shading import (
    integrate_normals,
    lambertian,
    lambertian_backward,
    mesh_from_depth,
    normals_from_depth,
    photometric_stereo,
    shape_from_shading,
)

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = ("estimate_lights", "lights_from_sphere", "mesh_from_depth")


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function that has own kernels."""
    depth, light = np.zeros((6, 9)), np.array([[0.1, 0.2, 0.9]])
    mesh = mesh_from_depth(depth)
    yield "lambertian", partial(lambertian, depth, light, shadows="cast")
    yield "lambertian", partial(lambertian, mesh, light, shape=(6, 9))
    yield "lambertian_backward", partial(lambertian_backward, np.zeros((1, 6, 9)), depth, light)
    yield "normals_from_depth", partial(normals_from_depth, depth)
    images, lights = np.ones((3, 6, 9)), np.eye(3)
    for method in ("least_squares", "consensus"):
        stereo = partial(photometric_stereo, images, lights, method=method)
        yield "photometric_stereo", stereo
    normals = np.full((6, 9, 3), [0.1, 0, 1])
    yield "integrate_normals", partial(integrate_normals, normals)
    yield "integrate_normals", partial(integrate_normals, normals, method="bilateral")
    known = np.full((6, 9, 3), np.nan)
    known[0] = [0, 0, 1]
    shape = partial(shape_from_shading, images[0], [0, 0, 1], boundary=known, rounds=1)
    yield "shape_from_shading", shape
