"""Calls that compile the kernels of radiance fields."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cvkern.app.warmup import pictures
from cvkern.radiance import (
    Composite,
    HashField,
    MLPField,
    PlanesField,
    Scene,
    SplatField,
    VoxelField,
    composite_rays,
    composite_rays_backward,
    fit,
    make_scene,
    planes_from_depth,
    positional_encoding,
    render,
    spherical_harmonics,
)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function, and for training each kind of field."""
    _, real, color = pictures()
    samples = real[:, 0], real[:, :3], real[:, :2], np.array([[0, 4]])
    seen = Composite(real[:1, :3], real[0, :1], real[0, :1], real[0, :1])
    yield "composite_rays", partial(composite_rays, *samples)
    yield "composite_rays_backward", partial(composite_rays_backward, seen, *samples)
    yield "positional_encoding", partial(positional_encoding, real)
    yield "spherical_harmonics", partial(spherical_harmonics, color)
    yield "make_scene", _scene
    for field in (
        VoxelField(resolutions=(16, 32), shares=(0.3,), rays=64),
        HashField(table_bits=10, samples=2**12, rays=64, cells=32),
        # Kernels are compiled for each width, so keep the default widths.
        MLPField(samples=2**8, rays=16, cells=8, steps=16),
    ):
        yield "fit", partial(_train, field, "affine")
    small = HashField(table_bits=10, samples=2**12, rays=64, cells=32)
    yield "fit", partial(_train, small, "embedding")
    yield "fit", _train_planes
    yield "fit", _train_splats
    yield "planes_from_depth", _show_planes


def _scene() -> Scene:
    return make_scene(train=2, test=1, size=16)


def _train_planes() -> None:
    scene = make_scene(train=3, test=0, size=16, layout="forward")
    blended = PlanesField(planes=2, rays=64, basis=2, references=2)
    fit(scene, blended, steps=1, progress=False)


def _train_splats() -> None:
    """Train until splats have been relocated."""
    scene, field = _scene(), SplatField(splats=64, start="random", fade=0.1)
    masked = replace(scene, masks=np.ones(scene.images.shape[:3], bool))
    fit(masked, field, steps=301, appearance="affine", progress=False)


def _show_planes() -> None:
    """Render texels of 8 bits; training reads them in float32."""
    image, K = np.zeros((4, 5, 3), np.uint8), [[5, 0, 2], [0, 5, 1.5], [0, 0, 1]]
    model = planes_from_depth(image, np.ones((4, 5)), K, planes=2)
    render(model, model.cameras)


def _train(field: Any, appearance: str) -> None:
    """Train until a grid has been refined."""
    fit(
        _scene(), field, steps=18, background="learnt", appearance=appearance, robust=True,
        progress=False,
    )  # fmt: skip
