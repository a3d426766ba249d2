"""Overlapping pairs in a set of images: keypoints, matches, homographies, and a test."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_items, check_image, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.features._photographs import as_host
from cvkern.features.keypoints import Features, sift
from cvkern.features.matching import match_images
from cvkern.geometry.maps import find_homographies
from cvkern.transform.resampling import resize

WORK_PIXELS = 600_000  # size at which images are compared; larger ones are reduced to it
KEYPOINTS = 2000  # points of an image
FEW, FAINT = 500, 0.01  # an image with fewer points shows fainter ones too, up to this contrast
MAX_RATIO = 0.75  # nearest distance over the second nearest
THRESHOLD = 3.0  # distance of an inlier, in pixels of the compared images
LEAST_MATCHES = 8
# Above `MANY_IMAGES` images, only the `STRONG` best keypoints are matched between all pairs. Each
# image has `PARTNERS`: the images with most such matches. All keypoints are matched with partners.
MANY_IMAGES, STRONG, PARTNERS = 18, 500, 12
# Brown and Lowe, equation 13. A match is an inlier with probability 0.6 between images of one scene
# and 0.1 by chance. A pair must be 1000 times likelier than chance.
ALPHA, BETA = 8.0, 0.3
LEAST_SIDE = 16  # pixels; smaller images have no keypoints
# Pairs that are matched in one launch, which has memory for all their keypoints.
MANY_PAIRS, STRONG_PAIRS = 4096, 8192

Progress = Callable[[int, int, str], None]


class Link(NamedTuple):
    """Two images that overlap, and their matches."""

    first: int
    second: int
    matrix: np.ndarray
    """Maps (x, y, 1) of the first image to the second, (3, 3) float64."""
    points0: np.ndarray
    """Inliers (n, 2), x and y in the first image, float64."""
    points1: np.ndarray
    """The same matches in the second image."""
    overlapping: int
    """Number of matches in the overlap."""


class Heap(NamedTuple):
    """Images, and their small copies for the comparison."""

    images: list[Any]
    """The images as given, (H, W) or (H, W, C): arrays, or objects that `pixels` reads."""
    small: list[Any]
    """The same images, with at most `WORK_PIXELS` pixels each."""
    factors: np.ndarray
    """Sides of the small images over the sides of the large ones, (N, 2) in the order x, y."""
    whites: list[float]
    """The value of white in each image."""


def pixels(image: Any) -> Any:
    """Return the array of an image; one that lies on disk has a method that reads it."""
    return image.read() if hasattr(image, "read") else image


def read_ahead(images: Sequence[Any]) -> Generator[Any, None, None]:
    """Yield the arrays of images; of those on disk, the next one is read meanwhile.

    Whoever does not take all of them must close the generator, which waits for its thread.
    """
    if not any(hasattr(image, "read") for image in images):
        yield from images
        return
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(pixels, images[0])
        for image in images[1:]:
            array, coming = coming.result(), pool.submit(pixels, image)
            yield array
        yield coming.result()


def check_heap(images: Any, data_range: float | None) -> list[Any]:
    """Check the images and return them as arrays, without running a kernel."""
    if isinstance(images, np.ndarray) and images.ndim < 3:
        raise ValueError("images must be a sequence of arrays, got one array")
    checked = []
    for i, image in enumerate(as_items(images, "images", "a sequence of arrays")):
        image = check_image(image, ndim=(2, 3), name=f"images[{i}]")
        shape = tuple(image.shape)
        if len(shape) == 3 and shape[2] not in (1, 3, 4):
            raise ValueError(f"images[{i}] must have 1, 3 or 4 channels, got shape {shape}")
        checked.append(image)
    if not checked:
        raise ValueError("images must not be empty, got none")
    if data_range is not None:
        check_positive(data_range, "data_range")
    return checked


def make_small(images: list[Any], data_range: float | None) -> Heap:
    """Shrink images to the size of the comparison."""
    small, factors = [], []
    for image in images:
        height, width = image.shape[:2]
        scale = min(1.0, math.sqrt(WORK_PIXELS / (height * width)))
        sides = max(1, round(height * scale)), max(1, round(width * scale))
        factors.append((sides[1] / width, sides[0] / height))
        small.append(image if sides == (height, width) else resized(image, sides))
    whites = [white_of(image, data_range) for image in images]
    return Heap(images, small, np.array(factors), whites)


def resized(image: Any, sides: tuple[int, int]) -> Any:
    """Return an image (H, W) or (H, W, C) at another size: bytes stay bytes."""
    byte = library(image).dtype(image) == np.uint8
    axis = -1 if len(image.shape) == 3 else None
    return resize(image, sides, channel_axis=axis, dtype=np.uint8 if byte else np.float32)


def link_images(heap: Heap, say: Progress) -> list[Link]:
    """Find the pairs that overlap, in the order of their indices."""
    count = len(heap.images)
    found = []
    for i, image in enumerate(heap.small):
        say(i, 2 * count, "Keypoints")
        found.append(keypoints(image, heap.whites[i]))
    return link_features(runtime(*heap.images), heap, found, say)


def link_features(
    rt: Runtime, heap: Heap, found: Sequence[Any], say: Progress, at_once: int = MANY_PAIRS
) -> list[Link]:
    """Find the pairs that overlap, given the features of the images.

    Those of at most `at_once` pairs are needed at a time.
    """
    count = len(heap.images)
    if count < 2:
        return []
    say(count, 2 * count, "Matching")
    pairs = _likely_pairs(rt, found)
    kept, given = [], []
    for first in range(0, len(pairs), at_once):
        names, places = np.unique(pairs[first : first + at_once], return_inverse=True)
        part = [found[n] for n in names]
        points = [as_host(rt, f.points).astype(np.float64) for f in part]
        places = places.reshape(-1, 2)
        matches = match_images(part, places, max_ratio=MAX_RATIO)
        for k, (m, (i, j)) in enumerate(zip(matches, places, strict=True), first):
            if len(m) >= LEAST_MATCHES:
                chosen = as_host(rt, m)
                kept.append(k)
                given.append((points[i][chosen[:, 0]], points[j][chosen[:, 1]]))
    if not kept:
        return []
    say(3 * count // 2, 2 * count, "Homographies")
    fits = find_homographies(given, THRESHOLD)
    links = []
    for n, k in enumerate(kept):
        inliers = np.asarray(fits.inliers[fits.offsets[n] : fits.offsets[n + 1]])
        i, j = pairs[k].tolist()
        link = _accepted(heap, i, j, fits.matrices[n], given[n], inliers)
        links += [link] if link else []
    return links


def _likely_pairs(rt: Runtime, found: Sequence[Any]) -> np.ndarray:
    """Return the pairs (P, 2), i < j, for which to match all keypoints.

    Among many images, pair each one with those that share most matches of strong keypoints with it.
    """
    count = len(found)
    pairs = np.stack(np.triu_indices(count, 1), axis=1)
    if count <= MANY_IMAGES:
        return pairs
    strong = []
    for features in found:
        order = np.argsort(-as_host(rt, features.responses), kind="stable")[:STRONG]
        strong.append(rt.give(as_host(rt, features.descriptors)[np.sort(order)]))
    numbers = np.zeros((count, count), int)
    for first in range(0, len(pairs), STRONG_PAIRS):
        part = pairs[first : first + STRONG_PAIRS]
        matches = match_images(strong, part, max_ratio=MAX_RATIO)
        numbers[part[:, 0], part[:, 1]] = [len(m) for m in matches]
    numbers += numbers.T
    nearest = np.argsort(-numbers, axis=1, kind="stable")[:, :PARTNERS]
    likely = np.zeros((count, count), bool)
    likely[np.arange(count)[:, None], nearest] = True
    likely = (likely | likely.T) & (numbers > 0)
    return pairs[likely[pairs[:, 0], pairs[:, 1]]]


def keypoints(image: Any, white: float) -> Features:
    """Return the features by which images are compared."""
    if min(image.shape[:2]) < LEAST_SIDE:
        none = np.zeros(0, np.float32)
        return Features(none.reshape(0, 2), none, none, none, np.zeros((0, 128), np.uint8))
    if len(image.shape) == 3 and image.shape[2] == 1:
        image = image.reshape(image.shape[:2])
    return keypoints_of(image, KEYPOINTS, spread=True, data_range=white)


def keypoints_of(image: Any, most: int, **options: Any) -> Features:
    """Return the features of SIFT; fainter ones too, if there are few."""
    found = sift(image, most, **options)
    if len(found.points) >= min(FEW, most):
        return found
    return sift(image, most, contrast_threshold=FAINT, **options)


def _accepted(
    heap: Heap,
    i: int,
    j: int,
    matrix: np.ndarray,
    points: tuple[np.ndarray, np.ndarray],
    inliers: np.ndarray,
) -> Link | None:
    """Return the pair, in pixels of the large images, if it has more inliers than by chance."""
    if not np.isfinite(matrix).all():
        return None
    a, b = (p[:, ::-1] for p in points)
    there, depth = mapped(matrix, a)
    height, width = heap.small[j].shape[:2]
    inside = (depth > 0) & (there >= -0.5).all(axis=1)
    inside &= (there <= (width - 0.5, height - 0.5)).all(axis=1)
    number, overlapping = int(inliers.sum()), int((inside | inliers).sum())
    if number <= ALPHA + BETA * overlapping:
        return None
    # A photograph is never a mirror image of another: the map preserves orientation.
    if np.linalg.det(matrix) <= 0 or not (depth[inliers] > 0).all():
        return None
    scale = [to_small(heap.factors[k]) for k in (i, j)]
    large = np.linalg.inv(scale[1]) @ matrix @ scale[0]
    a, b = ((p[inliers] + 0.5) / heap.factors[k] - 0.5 for p, k in ((a, i), (b, j)))
    return Link(i, j, large / np.cbrt(np.linalg.det(large)), a, b, overlapping)


def to_small(factors: np.ndarray) -> np.ndarray:
    """Return the matrix that maps a large image to the small one."""
    x, y = factors
    return np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1]])


def mapped(matrix: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the images of points (N, 2), x and y, under a homography, and their depths."""
    q = points @ matrix[:, :2].T + matrix[:, 2]
    depth = q[:, 2] * np.sign(matrix[2, 2] or 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return q[:, :2] / q[:, 2:], depth


def connected(count: int, links: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Return the connected components: the largest first, then by their least index."""
    parent = list(range(count))

    def root(i: int) -> int:
        # A parent has a smaller index than its child, or is a root.
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    for i, j in links:
        a, b = sorted((root(i), root(j)))
        parent[b] = a
    groups: dict[int, list[int]] = {}
    for i in range(count):
        groups.setdefault(root(i), []).append(i)
    return sorted(groups.values(), key=lambda group: (-len(group), group[0]))
