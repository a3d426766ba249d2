"""Images for the cases, and their conversion to and from each library's own array type."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np


def noise(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Uniform noise in [0, 1), float32: every pixel an edge candidate."""
    return rng.random(shape, np.float32)


def noise_uint8(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, shape, np.uint8)


def photograph_uint8(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """scikit-image's cameraman, mirrored on and on from a random pixel until it fills `shape`."""
    photo = _camera()
    rows, columns = (
        _mirrored(np.arange(n) + rng.integers(0, 2 * m), m)
        for n, m in zip(shape, photo.shape, strict=True)
    )
    return np.ascontiguousarray(photo[np.ix_(rows, columns)])


def photograph(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return photograph_uint8(shape, rng).astype(np.float32) / np.float32(255)


@cache
def _camera() -> np.ndarray:
    return importlib.import_module("skimage.data").camera()


def _mirrored(index: np.ndarray, size: int) -> np.ndarray:
    index = index % (2 * size)
    return np.minimum(index, 2 * size - 1 - index)


def load(array: np.ndarray, module: str, device: str) -> Any:
    """Give `array` to the library that `module` belongs to, on `device`."""
    library = module.partition(".")[0]
    if library == "kornia_rs":  # wants its channel axis, and its own image on a GPU
        array = array[..., None]
        if device == "cpu":
            return array
        return importlib.import_module("kornia_rs.image").Image.from_numpy(array).to_cuda()
    if device == "cpu":
        return array
    if library in ("cupyx", "cucim", "cupy"):
        return importlib.import_module("cupy").asarray(array)
    if library == "torch":
        return importlib.import_module("torch").from_numpy(array).cuda()
    if library == "cvcuda":
        tensor = load(array, "torch", device)
        return importlib.import_module("cvcuda").as_tensor(tensor[None, ..., None], "NHWC")
    if library == "warp":
        return importlib.import_module("warp").array(array, device="cuda")
    raise ValueError(f"module must belong to a library with a loader, got {module!r}")


def carrier() -> str:
    """Name the library whose CUDA arrays cvkern is given: the one most users hold."""
    for library in ("torch", "cupy"):
        try:
            importlib.import_module(library)
        except ImportError:
            continue
        return library
    return "warp"


def to_host(array: Any) -> np.ndarray:
    """Copy an answer of any library to NumPy, (H, W) where there is one channel."""
    if isinstance(array, (np.ndarray, np.generic)):
        host = np.asarray(array)
    elif type(array).__module__.startswith("cupy"):
        host = array.get()
    elif hasattr(array, "to_numpy"):  # kornia_rs
        host = array.to_numpy()
    elif hasattr(array, "cpu"):  # torch
        host = array.cpu().numpy()
    elif hasattr(array, "cuda"):  # CV-CUDA
        host = importlib.import_module("torch").as_tensor(array.cuda(), device="cuda").cpu().numpy()
    else:
        host = array.numpy()
    if host.ndim == 4:
        host = host[0]
    return host[..., 0] if host.ndim == 3 and host.shape[-1] == 1 else host


def fields(answer: Any) -> tuple[np.ndarray, ...]:
    """Copy an answer, one array or a tuple of them, to a tuple of NumPy arrays."""
    return tuple(map(to_host, answer)) if isinstance(answer, tuple) else (to_host(answer),)
