"""Photographs of a heap on disk: their keypoints are kept, their pixels are read again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern.features._photographs import converted, dtype_of_most
from cvkern.features.keypoints import Features
from cvkern.images.files import read_image
from cvkern.panorama.registration import Heap, check_heap, keypoints, make_small


class Description(NamedTuple):
    """What a panorama needs to know of a photograph before it is drawn."""

    small: np.ndarray
    """The photograph at the size of the comparison."""
    points: np.ndarray
    responses: np.ndarray
    descriptors: np.ndarray
    shape: np.ndarray
    """The shape of the photograph."""
    factors: np.ndarray
    """Sides of the small one over those of the large one, in the order x, y."""
    like: np.ndarray
    """An empty array of the photograph's dtype."""
    white: np.ndarray
    """The value of white in the photograph, ()."""


def described(image: np.ndarray, data_range: float | None) -> Description:
    """Find the keypoints of a photograph, as :func:`cvkern.stitch` does."""
    one = make_small(check_heap([image], data_range), data_range)
    found = keypoints(one.small[0], one.whites[0])
    return Description(
        one.small[0], found.points, found.responses, found.descriptors,
        np.array(image.shape), one.factors[0], np.empty(0, image.dtype), np.array(one.whites[0]),
    )  # fmt: skip


class Held:
    """The photographs that were read last, of at most so many bytes together."""

    def __init__(self, most: int) -> None:
        self.most, self.size = most, 0
        self.arrays: OrderedDict[Path, np.ndarray] = OrderedDict()

    def read(self, photograph: Photograph) -> np.ndarray:
        """Return the pixels of a photograph."""
        file = photograph.file
        if file in self.arrays:
            self.arrays.move_to_end(file)
            return self.arrays[file]
        while self.arrays and self.size + photograph.bytes > self.most:
            self.size -= self.arrays.popitem(last=False)[1].nbytes
        array = photograph.decoded()
        self.arrays[file] = array
        self.size += array.nbytes
        return array


class Change(NamedTuple):
    """How the pixels of a photograph become those of the dtype that its heap has in common."""

    own: np.dtype
    dtype: np.dtype
    own_white: float
    white: float

    def of(self, image: np.ndarray) -> np.ndarray:
        """Return an image of the common dtype; one that has it already is kept."""
        if self.own == self.dtype:
            return image
        return converted(image, self.own_white, self.dtype, self.white)


class Photograph:
    """A photograph in a file, as one of the dtype that its heap has in common."""

    def __init__(self, file: Path, shape: list[int], change: Change, held: Held):
        self.file, self.shape, self.change, self.held = file, tuple(shape), change, held
        self.dtype = change.dtype

    @property
    def bytes(self) -> int:
        """The size of the pixels."""
        return int(np.prod(self.shape)) * self.dtype.itemsize

    def read(self) -> np.ndarray:
        """Return the pixels."""
        return self.held.read(self)

    def decoded(self) -> np.ndarray:
        """Read the file."""
        image = read_image(self.file)
        if image.shape != self.shape or image.dtype != self.change.own:
            raise ValueError(f"paths must not change meanwhile, but {str(self.file)!r} did")
        return self.change.of(image)


class Small:
    """The small copy of a photograph, in the file of its description."""

    def __init__(self, file: Path, shape: tuple[int, ...], change: Change):
        self.file, self.shape, self.change = file, shape, change
        self.dtype = change.dtype

    def read(self) -> np.ndarray:
        """Return the pixels: bytes of bytes, else float32."""
        with np.load(self.file) as archive:
            small = self.change.of(archive["small"])
        return small if small.dtype == np.uint8 else small.astype(np.float32, copy=False)


class Keypoints(Sequence[Features]):
    """The features of the photographs of a heap, each read when it is asked for."""

    def __init__(self, files: list[Path]) -> None:
        self.files = files

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, n: Any) -> Any:
        with np.load(self.files[n]) as archive:
            parts = [archive[name] for name in ("points", "responses", "descriptors")]
        none = np.zeros(0, np.float32)
        return Features(parts[0], none, none, parts[1], parts[2])


def heap_of(files: list[Path], notes: list[Path], most: int) -> Heap:
    """Return a heap whose images are read when they are needed.

    `notes` are the files of the descriptions, and photographs of `most` bytes stay in memory.
    """
    own, whites, shapes, small, factors = [], [], [], [], []
    for note in notes:
        with np.load(note) as archive:
            own.append(archive["like"].dtype)
            whites.append(float(archive["white"]))
            shapes.append(archive["shape"].tolist())
            small.append(archive["small"].shape)
            factors.append(archive["factors"])
    dtype, held = dtype_of_most(own), Held(most)
    white = max(w for w, o in zip(whites, own, strict=True) if o == dtype)
    changes = [Change(o, dtype, w, white) for o, w in zip(own, whites, strict=True)]
    return Heap(
        [Photograph(f, s, c, held) for f, s, c in zip(files, shapes, changes, strict=True)],
        [Small(n, s, c) for n, s, c in zip(notes, small, changes, strict=True)],
        np.array(factors),
        [c.own_white if c.own == dtype else white for c in changes],
    )
