"""The parts of a case: its inputs, its call, its oracle, its peers, and its unavoidable work."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import fields

Shape = tuple[int, int]
Inputs = tuple[Any, ...]  # one image, a pair, ...
SIZES: dict[str, Shape] = {
    "VGA": (480, 640),
    "1024x440": (440, 1024),  # a stereo camera's: what semi-global matchers are compared on
    "1080p": (1080, 1920),
    "4K": (2160, 3840),
    "8192": (8192, 8192),
}
TOY: Shape = (96, 128)
MARGIN = 16  # pixels at the border, which a peer may treat otherwise


class CheckFailedError(Exception):
    """An answer is not the oracle's; nothing of that case is timed."""


@dataclass(frozen=True)
class Peer:
    """A call of another library, made the way its users make it."""

    name: str
    module: str  # imported when the case runs; the peer is absent where that fails
    call: Callable[..., Any]  # (module, *inputs) -> answer
    device: str = "cpu"
    note: str = ""  # what it computes otherwise than the case


def in_float64(call: Callable[[Any, Any, Any], Any]) -> Callable[[np.ndarray], Any]:
    """Make an oracle of SciPy: `call` is (ndimage, array, NumPy)."""
    ndimage = importlib.import_module("scipy.ndimage")
    return lambda image: call(ndimage, image.astype(np.float64), np)


def ndimage_peers(call: Callable[[Any, Any, Any], Any]) -> tuple[Peer, Peer]:
    """Give SciPy, and CuPy that mirrors it, as peers: `call` is (ndimage, array, NumPy or CuPy)."""
    return (
        Peer("SciPy", "scipy.ndimage", lambda m, x: call(m, x, np)),
        Peer(
            "CuPy",
            "cupyx.scipy.ndimage",
            lambda m, x: call(m, x, importlib.import_module("cupy")),
            "cuda",
        ),
    )


def skimage_peers(
    module: str, call: Callable[[Any, Any], Any], note: str = ""
) -> tuple[Peer, Peer]:
    """Give scikit-image's `module`, and cuCIM that mirrors it, as peers."""
    return (
        Peer("scikit-image", f"skimage.{module}", call, "cpu", note),
        Peer("cuCIM", f"cucim.skimage.{module}", call, "cuda", note),
    )


def kornia_peers(call: Callable[[Any, Any], Any], note: str = "") -> tuple[Peer, Peer]:
    """Give kornia-rs as a peer on either device: its functions go where the image lies."""
    one, two = (Peer("kornia-rs", "kornia_rs.imgproc", call, d, note) for d in ("cpu", "cuda"))
    return one, two


@dataclass(frozen=True)
class Work:
    """What a call does, where that says more than its bytes: votes, disparities, rays."""

    unit: str  # in the plural
    count: Callable[..., float]  # (*inputs) -> how many a call does


@dataclass(frozen=True)
class Case:
    """One operation on one kind of image, or of several images at once."""

    name: str
    title: str
    image: Callable[[Shape, np.random.Generator], Any]  # one array, or a tuple: the inputs
    call: Callable[..., Any]  # (*inputs): the public function of cvkern, as a user calls it
    oracle: Callable[..., Any]  # (*inputs) -> the right answer, by a library that is not cvkern
    oracle_name: str
    difference: Callable[[Any, Any], float]  # (answer, right answer), as tuples of host arrays
    tolerance: float
    bytes_per_pixel: int  # each input read once, each output written once
    operations_per_pixel: float
    peers: tuple[Peer, ...] = ()
    captures: bool = True  # False for what cvkern.capture refuses
    work: Work | None = None
    sizes: tuple[str, ...] = ("1080p", "4K")  # unless --size says otherwise
    most_inputs: int = 32  # fewer where a captured call keeps much memory of its own
    margin: int = MARGIN  # 0 where answers are no images

    def inputs(self, shape: Shape, rng: np.random.Generator) -> Inputs:
        """Make the inputs of one call."""
        made = self.image(shape, rng)
        return made if isinstance(made, tuple) else (made,)

    def compare(self, answer: Any, right: tuple[np.ndarray, ...]) -> float:
        """Return how far a peer's answer is from the right one, away from the border."""
        inner = np.s_[self.margin : -self.margin, self.margin : -self.margin]
        ours, theirs = (
            tuple(a[inner] if self.margin else a for a in f) for f in (fields(answer), right)
        )
        return float(self.difference(ours, theirs))

    def check(self, answer: Any, right: tuple[np.ndarray, ...]) -> float:
        """Return how far cvkern's answer is from the right one; raise where that is too far."""
        ours = fields(answer)
        found = float(self.difference(ours, right)) if len(ours) == len(right) else np.inf
        if not found <= self.tolerance:
            raise CheckFailedError(
                f"{self.name}: difference from {self.oracle_name} must be <= {self.tolerance:g}, "
                f"got {found:g}"
            )
        return found


def relative(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Largest absolute difference over the largest right value, of the worst field; or NaN."""
    worst = [0.0]
    for a, b in zip(ours, theirs, strict=False):
        if a.shape != b.shape:
            return np.inf
        gap = np.abs(a.astype(np.float64) - b).max(initial=0.0)
        worst.append(gap / max(np.abs(b).max(initial=0.0), np.finfo(np.float32).tiny))
    return float(np.max(worst))


def disagreeing(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Share of the pixels that differ; masks of 0/255 count as masks of 0/1."""
    (a,), (b,) = ours, theirs
    if a.shape != b.shape:
        return np.inf
    return float(np.mean((a != 0) != (b != 0)))


def unequal(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Share of the elements that are not equal."""
    (a,), (b,) = ours, theirs
    return float(np.mean(a != b)) if a.shape == b.shape else np.inf
