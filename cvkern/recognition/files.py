"""Shape models as files: plain arrays without pickled objects, all checked before they are used."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from cvkern import _archives
from cvkern.kernels.codes.recognition import MOST_WORDS
from cvkern.recognition.codebook import METHODS, MOST_CODEBOOK
from cvkern.recognition.fitting import Fitted
from cvkern.recognition.patches import LEAST_SIDE, MOST_SIDE, MOST_STEP, POINTS, Sampling
from cvkern.recognition.training import MOST_LAYERS, MOST_SIZE, Settings

ARRAYS = {"words": np.int8, "starts": np.int32, "entries": np.int32, "figures": np.uint8,
          "weights": np.int32}  # fmt: skip
KIND = _archives.Kind("cvkern shape model", 1, tuple(ARRAYS))
MOST_OCCURRENCES = 2**24


def write(path: str | os.PathLike[str], settings: Settings, fitted: Fitted) -> None:
    """Write a model, whole or not at all."""
    _archives.check_path(path)
    header = {
        "settings": {**settings._asdict(), "sampling": settings.sampling._asdict()},
        "bias": fitted.bias,
        "threshold": fitted.threshold,
        "usual": fitted.usual,
    }
    _archives.write(path, KIND, header, {name: getattr(fitted, name) for name in ARRAYS})


def read(path: str | os.PathLike[str]) -> tuple[Settings, Fitted]:
    """Read a model that :func:`write` wrote; refuse a damaged one."""
    with _archives.opened(path, KIND) as (header, arrays):
        settings = _settings(header["settings"])
        shapes = {name: arrays.shape(name) for name in ARRAYS}
        _check_shapes(shapes, settings)
        loaded = {name: arrays[name] for name in ARRAYS}
        for name, dtype in ARRAYS.items():
            if loaded[name].dtype != dtype:
                raise ValueError(f"{name} must be {np.dtype(dtype)}, got {loaded[name].dtype}")
        _check_values(loaded)
        bias, threshold = int(header["bias"]), float(header["threshold"])
        usual = float(header.get("usual", 1.0))  # the first files had none
        if abs(bias) >= 2**30 or not math.isfinite(threshold) or not 0 < usual < math.inf:
            raise ValueError(
                f"bias and threshold must be in range, got {bias}, {threshold}, {usual}"
            )
    return settings, Fitted(**loaded, bias=bias, threshold=threshold, usual=usual)


def _settings(given: Any) -> Settings:
    """Return settings that are those of a model."""
    if set(given) != set(Settings._fields) or set(given["sampling"]) != set(Sampling._fields):
        raise ValueError(f"settings must be {Settings._fields}, got {sorted(given)}")
    settings = Settings(**{**given, "sampling": Sampling(**given["sampling"])})
    side, points, step = settings.sampling
    ranges = (
        (settings.words, 1, MOST_CODEBOOK), (settings.most, 1, MOST_WORDS),
        (side, LEAST_SIDE, MOST_SIDE), (step, 1, MOST_STEP), (settings.height, side, MOST_SIZE),
        (settings.width, side, MOST_SIZE), (settings.layers, 1, MOST_LAYERS),
    )  # fmt: skip
    if (
        any(not isinstance(n, int) or not low <= n <= high for n, low, high in ranges)
        or not 0 < float(settings.correlation) <= 1
        or points not in POINTS
        or settings.method not in METHODS[1:]
    ):
        raise ValueError(f"settings must be in range, got {settings}")
    return settings


def _check_shapes(shapes: dict[str, tuple[int, ...]], settings: Settings) -> None:
    """Refuse arrays that do not fit each other, before any is read."""
    count, occurrences = shapes["words"][0], shapes["entries"][0]
    side = settings.sampling.side
    wanted = {
        "words": (count, settings.sampling.size),
        "starts": (count + 1,),
        "entries": (occurrences, 4),
        "weights": (count, settings.cells),
        "figures": (occurrences, side * side) if shapes["figures"][0] else (0, 0),
    }
    if not (1 <= count <= MOST_CODEBOOK and occurrences <= MOST_OCCURRENCES) or wanted != shapes:
        raise ValueError(f"arrays must have shapes that agree, got {shapes}")


def _check_values(arrays: dict[str, np.ndarray]) -> None:
    """Refuse places and weights that kernels cannot add up."""
    starts, entries = arrays["starts"], arrays["entries"]
    if starts[0] != 0 or starts[-1] != len(entries) or (np.diff(starts) < 0).any():
        raise ValueError("starts must rise from 0 to the number of entries, got others")
    most = np.abs(entries.astype(np.int64)).max(axis=0, initial=0)
    if (most >= (2**15, 2**15, 2**10, 2**16 + 1)).any() or (entries[:, 3] < 0).any():
        raise ValueError("entries must be in range, got others")
    if np.abs(arrays["weights"].astype(np.int64)).max(initial=0) > 2**17:
        raise ValueError("weights must be in range, got others")
