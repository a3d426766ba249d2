"""Objects made of textured parts, found among such parts; and a face, found in a photograph."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np
import scipy.ndimage as ndi

import cvkern
from profiling.arrays import photograph_uint8, to_host
from profiling.case import TOY, Case, Shape, Work

SIDE = 16  # pixels of a part
SCALES = (0.84, 1.0, 1.19)
WORDS, TOY_WORDS = 2000, 60
FACE = 60  # rows and columns


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


@cache
def _face() -> np.ndarray:
    photo = importlib.import_module("skimage.data").astronaut().mean(axis=2)
    return photo[70 : 70 + 2 * FACE : 2, 160 : 160 + 2 * FACE : 2]


@cache
def _model_of_face(words: int) -> cvkern.ShapeModel:
    """Return a model of the face in other light, against photographs of other things."""
    rng = np.random.default_rng(1)
    photos = importlib.import_module("skimage.data")
    names = ("coins", "brick", "grass", "page", "text", "moon")
    count, names = (60, names) if words == WORDS else (4, names[:2])
    seen = [_face() * rng.uniform(0.7, 1.2) + rng.normal(0, 4, (FACE, FACE)) for _ in range(count)]
    pictures = [np.clip(picture, 0, 255).astype(np.uint8) for picture in seen]
    with cvkern.use(backend="warp", device="cpu"):
        return cvkern.ShapeModel(words, mirror=False).fit(
            pictures,
            masks=[np.ones((FACE, FACE), bool)] * count,
            negatives=[getattr(photos, name)()[:200, :260] for name in names],
        )


def _photograph(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a photograph with the face in it, and the face's middle."""
    scene = photograph_uint8(shape, rng)
    row, column = (int(rng.integers(4, n - FACE - 4)) for n in shape)
    scene[row : row + FACE, column : column + FACE] = _face()
    return scene, np.array([row, column]) + (FACE - 1) / 2


def _segment(scene: Any, _: Any) -> np.ndarray:
    """Return the middle of the mask of the strongest."""
    found = _model_of_face(_words_for(scene)).segment(scene, scales=SCALES)
    masks = to_host(found.masks)
    return np.argwhere(masks[0]).mean(axis=0) if len(masks) else np.full(2, np.inf)


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
    Case(
        name="segment_face",
        title="Pixels of a face in a photograph, by 2000 visual words at three scales, uint8",
        image=_photograph,
        call=_segment,
        oracle=lambda _, middle: middle,
        oracle_name="where the face was put",
        difference=_farthest,
        tolerance=4.0,  # a mask is made of patches, every four pixels
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
