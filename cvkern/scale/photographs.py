"""Photographs of a heap on disk: their keypoints are kept, their pixels are read again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern.features._photographs import converted, dtype_of_most, white_of
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


def described(image: np.ndarray, white: float | None) -> Description:
    """Find the keypoints of a photograph, as :func:`cvkern.stitch` does."""
    one = make_small(check_heap([image], white), white)
    found = keypoints(one.small[0], white_of(image, white))
    return Description(
        one.small[0], found.points, found.responses, found.descriptors,
        np.array(image.shape), one.factors[0], np.empty(0, image.dtype),
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


class Photograph:
    """A photograph in a file, as one of the dtype that its heap has in common."""

    def __init__(self, file: Path, own: np.dtype, shape: list[int], dtype: np.dtype, held: Held):
        self.file, self.own, self.shape, self.dtype = file, own, tuple(shape), dtype
        self.held = held

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
        if image.shape != self.shape or image.dtype != self.own:
            raise ValueError(f"paths must not change meanwhile, but {str(self.file)!r} did")
        return image if self.own == self.dtype else converted(image, white_of(image), self.dtype)


class Small:
    """The small copy of a photograph, in the file of its description."""

    def __init__(self, file: Path, own: np.dtype, shape: tuple[int, ...], dtype: np.dtype):
        self.file, self.own, self.shape, self.dtype = file, own, shape, dtype

    def read(self) -> np.ndarray:
        """Return the pixels: bytes of bytes, else float32."""
        with np.load(self.file) as archive:
            small = archive["small"]
        if self.own == self.dtype:
            return small
        small = converted(small, white_of(np.empty(0, self.own)), self.dtype)
        return small if self.dtype == np.uint8 else small.astype(np.float32)


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


def heap_of(files: list[Path], notes: list[Path], white: float | None, most: int) -> Heap:
    """Return a heap whose images are read when they are needed.

    `notes` are the files of the descriptions, and photographs of `most` bytes stay in memory.
    """
    own, shapes, small, factors = [], [], [], []
    for note in notes:
        with np.load(note) as archive:
            own.append(archive["like"].dtype)
            shapes.append(archive["shape"].tolist())
            small.append(archive["small"].shape)
            factors.append(archive["factors"])
    dtype, held = dtype_of_most(own), Held(most)
    return Heap(
        [Photograph(f, o, s, dtype, held) for f, o, s in zip(files, own, shapes, strict=True)],
        [Small(n, o, s, dtype) for n, o, s in zip(notes, own, small, strict=True)],
        np.array(factors),
        white,
    )
