"""Objects made of textured parts, found among such parts."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import scipy.ndimage as ndi

import cvkern
from profiling.arrays import to_host
from profiling.case import TOY, Case, Shape, Work

SIDE = 16  # pixels of a part
SCALES = (0.84, 1.0, 1.19)
WORDS, TOY_WORDS = 2000, 60


@cache
def _parts() -> np.ndarray:
    """Return smooth textures (N, 16, 16) in bytes."""
    noise = np.random.default_rng(0).normal(size=(24, SIDE, SIDE))
    smooth = np.asarray(ndi.gaussian_filter(noise, (0, 1.5, 1.5)))
    low, high = (f(smooth, axis=(1, 2), keepdims=True) for f in (np.min, np.max))
    return (255 * (smooth - low) / (high - low)).astype(np.uint8)


def _sheet(order: np.ndarray) -> np.ndarray:
    """Return parts side by side."""
    rows, columns = order.shape
    return _parts()[order].transpose(0, 2, 1, 3).reshape(SIDE * rows, SIDE * columns)


def _object() -> np.ndarray:
    return _sheet(np.arange(6).reshape(2, 3))


def _clutter(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    rows, columns = (-(-n // SIDE) for n in shape)
    return _sheet(rng.integers(0, 24, (rows, columns)))[: shape[0], : shape[1]].copy()


@cache
def _model(words: int) -> cvkern.ShapeModel:
    """Return a model of objects with noise, against parts in no order."""
    rng = np.random.default_rng(1)
    count = 40 if words == WORDS else 3
    pictures = [_object() * 0.8 + rng.integers(0, 50, (32, 48)) for _ in range(count)]
    others = [_clutter((90, 130), rng) for _ in range(count)]
    with cvkern.use(backend="warp", device="cpu"):
        model = cvkern.ShapeModel(words, mirror=False)
        return model.fit([p.astype(np.uint8) for p in pictures], negatives=others)


def _inputs(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a scene and the middle of the object in it."""
    scene = _clutter(shape, rng)
    row, column = (int(rng.integers(8, n - m - 8)) for n, m in zip(shape, (32, 48), strict=True))
    scene[row : row + 32, column : column + 48] = _object()
    return scene, np.array([row + 15.5, column + 23.5])


def _words_for(scene: np.ndarray) -> int:
    return TOY_WORDS if tuple(scene.shape) == TOY else WORDS


def _find(scene: Any, _: Any) -> np.ndarray:
    """Return the middle of the strongest."""
    found = _model(_words_for(scene)).detect(scene, scales=SCALES)
    centers = to_host(found.centers)
    return centers[0] if len(centers) else np.full(2, np.inf)


def _farthest(ours: Any, right: Any) -> float:
    (a,), (b,) = ours, right
    return float(np.abs(a - b).max())


def _patches(scene: np.ndarray, _: Any) -> float:
    """Count the patches of all levels."""
    sides = [[n / scale / 4 for n in scene.shape] for s in SCALES for scale in (s, 2 * s)]
    return float(sum(down * along for down, along in sides))


CASES = (
    Case(
        name="shape_model",
        title="Objects by 2000 visual words at three scales, uint8",
        image=_inputs,
        call=_find,
        oracle=lambda _, middle: middle,
        oracle_name="where the object was put",
        difference=_farthest,
        tolerance=3.0,  # the grid of patches has a point every four pixels
        bytes_per_pixel=0,
        operations_per_pixel=0,
        captures=False,
        peers=(),
        work=Work("patches", _patches),
        sizes=("VGA",),
        most_inputs=2,
        margin=0,
    ),
)
