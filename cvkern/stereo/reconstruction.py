"""Depth from two photographs: matches, pose, rectification, disparities, and a cloud."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._ahead import compiles_ahead
from cvkern._checks import check_integer, check_positive
from cvkern._notices import warn
from cvkern.stereo.depth import PointCloud
from cvkern.stereo.matching import stereo_match

LONG_SIDES = 1.2  # guessed focal length of an unknown camera, in longer sides of the photograph
LEAST = 20  # smallest number of inliers
LONGEST = 1e30  # baseline: depths must fit into float32
SHARE = 0.005  # share of matches at each end that do not widen the range of disparities
MARGIN, LEAST_MARGIN = 0.1, 4  # extension of the range at each end: share of the range, or pixels
MOST_DISPARITIES = 512
FLAT = 0.9  # share of the matches from which on one map explains too many to tell depths

AHEAD = {
    True: ("geometry.find_fundamental", "stereo.stereo_match", "features.match_descriptors"),
    False: (
        "geometry.find_essential", "geometry.find_homography", "stereo.stereo_match",
        "features.match_descriptors",
    ),
}  # fmt: skip


class PairReconstruction(NamedTuple):
    """The reconstruction of a scene: sparse points, and a depth for each pixel."""

    image0: np.ndarray
    """The first photograph, rectified, (H, W) or (H, W, 3) uint8; black outside."""
    image1: np.ndarray
    """The second photograph, rectified, of the same shape."""
    H0: np.ndarray
    """(3, 3) float64: from the first photograph, as used, to `image0`; acts on (x, y, 1)."""
    H1: np.ndarray
    """(3, 3) float64, of the second photograph."""
    disparity: np.ndarray
    """(H, W) float32, pixels: the column in `image0` minus the column in `image1`."""
    valid: np.ndarray
    """(H, W) bool: the disparity is from a match, and the point is in front of both cameras."""
    depth: np.ndarray
    """(H, W) float32: z from the first camera, in units of the baseline; NaN where not valid."""
    cloud: PointCloud
    """Points of all valid pixels, (x, y, z) of the first camera, with their colours."""
    places: np.ndarray
    """(N, 2) float64: row and column in `image0` of the matches that gave the geometry."""
    sparse_disparity: np.ndarray
    """(N,) float64, pixels: the disparity of each of these matches."""
    points: np.ndarray
    """(N, 3) float64: the matches in space."""
    rotation: np.ndarray
    """(3, 3) float64: x1 = R x0 + t from the first camera to the second."""
    translation: np.ndarray
    """(3,) float64, as long as the baseline."""
    K: np.ndarray
    """(2, 3, 3) float64: the camera matrices of both photographs, as used."""


def reconstruct_pair(
    image0: Any,
    image1: Any,
    K: Any = None,
    baseline: float | None = None,
    *,
    threshold: float = 1.0,
    max_keypoints: int = 4000,
    max_ratio: float = 0.8,
    max_side: int = 1600,
    seed: int = 0,
) -> PairReconstruction:
    """Reconstruct a scene from two photographs of it, taken side by side.

    SIFT keypoints are matched. The matches give the pose of the second camera, and homographies
    that rectify both photographs. The rectified photographs are matched pixel by pixel, and each
    match gives a point. The scene must not move, and the camera must move more sideways than
    forwards.

    Parameters
    ----------
    image0, image1 : path, or array of shape (H, W) or (H, W, C) with C in 3, 4
        Photographs: uint8, uint16, or floats in [0, 1]; NumPy arrays. Alpha is ignored.
    K : array of shape (3, 3) or (2, 3, 3), optional
        Camera matrix of both photographs, or of each, for a lens without distortion. By default
        the focal length comes from the EXIF data of a file, or else it is 1.2 times the longer
        side, with a warning. The rows of the rectified photographs then match as well, but depths
        have a smooth distortion.
    baseline : float, optional
        Distance between both cameras, by default 1: depths are in its unit.
    threshold : float, default 1.0
        Largest Sampson distance of a match, pixels.
    max_keypoints : int, default 4000
        Keypoints of each photograph.
    max_ratio : float, default 0.8
        Largest ratio of descriptor distances, as in :func:`match_descriptors`.
    max_side : int, default 1600
        Largest side in pixels; larger photographs are reduced. `K` is that of the given size.
    seed : int, default 0
        Another seed draws other samples.

    Returns
    -------
    PairReconstruction
        Named tuple: the rectified photographs, dense and sparse disparities and points, the pose.

    Warns
    -----
    UserWarning
        If a focal length is guessed.

    Raises
    ------
    FileNotFoundError
        If a path names no file.
    TypeError
        If an image does not hold real numbers.
    ValueError
        If an argument is out of range, a file is no image, the photographs have too few matches of
        one geometry, they cannot be rectified, because the camera moved forwards, or one map fits
        nearly all matches: the camera only turned, or without `K` the scene is a plane.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> from skimage import data
    >>> left, right, _ = data.stereo_motorcycle()
    >>> K0 = np.array([[995.0, 0, 311], [0, 995, 255], [0, 0, 1]])
    >>> K1 = np.array([[995.0, 0, 342], [0, 995, 255], [0, 0, 1]])
    >>> pair = cvkern.reconstruct_pair(left, right, [K0, K1], 0.193, max_side=370)
    >>> pair.disparity.shape, bool(2 < np.nanmedian(pair.depth) < 4)  # metres
    ((250, 370), True)
    """
    from cvkern.images._overlay import canvas

    length = 1.0 if baseline is None else check_positive(baseline, "baseline")
    if not 1 / LONGEST <= length <= LONGEST:
        raise ValueError(f"baseline must be in [{1 / LONGEST:g}, {LONGEST:g}], got {baseline}")
    most = check_integer(max_side, "max_side", 64, 2**15)
    given = [_photograph(image, name) for image, name in ((image0, "image0"), (image1, "image1"))]
    cameras = _cameras(K, (image0, image1), given)
    with compiles_ahead(*AHEAD[K is None]):
        sized = [_reduced(photo, k, most) for photo, k in zip(given, cameras, strict=True)]
        photos, used = [photo for photo, _ in sized], np.stack([k for _, k in sized])
        a, b = _matches(photos, max_keypoints, max_ratio)
        f, a, b, rotation, translation = _geometry(a, b, used, K is not None, threshold, seed)
        translation = length * translation
        H0, H1, warped = _rectified(a, b, f, photos)
        one, other = _mapped(H0, a), _mapped(H1, b)
        sparse = one[:, 1] - other[:, 1]
        rays0, rays1 = _rays(a, used[0]), _rays(b, used[1])
        points = _depths(rays0, rays1, rotation, translation)[:, None] * rays0
        disparity, valid = _dense(warped, sparse, points[:, 2])
    space = _space(disparity, (H0, H1), used, rotation, translation)
    inside = [_inside(h, p.shape, disparity.shape) for h, p in zip((H0, H1), photos, strict=True)]
    rows, columns = np.indices(disparity.shape)
    there = np.rint(columns - disparity).astype(int)
    seen = (there >= 0) & (there < disparity.shape[1])
    seen &= inside[1][rows, there.clip(0, disparity.shape[1] - 1)]
    valid = valid & inside[0] & seen & (space[..., 2] > 0) & np.isfinite(space).all(axis=2)
    depth = np.where(valid, space[..., 2], np.nan).astype(np.float32)
    cloud = PointCloud(space[valid].astype(np.float32), canvas(warped[0])[valid])
    return PairReconstruction(
        warped[0], warped[1], H0, H1, disparity, valid, depth, cloud, one, sparse, points,
        rotation, translation, used,
    )  # fmt: skip


def _photograph(image: Any, name: str) -> np.ndarray:
    """Return a photograph as uint8, without alpha."""
    from cvkern.images._overlay import canvas, check_numbers
    from cvkern.images.files import read_image

    named = isinstance(image, (str, os.PathLike))
    try:
        photo = read_image(image) if named else check_numbers(image, name)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{name}: {error}") from None
    if photo.ndim not in (2, 3) or (photo.ndim == 3 and photo.shape[2] not in (3, 4)):
        raise ValueError(
            f"{name} must have shape (H, W), (H, W, 3) or (H, W, 4), got {photo.shape}"
        )
    if min(photo.shape[:2]) < 64:
        raise ValueError(f"{name} must be at least 64 x 64 pixels, got {photo.shape[:2]}")
    shown = canvas(photo, name)
    return shown if photo.ndim == 3 else np.ascontiguousarray(shown[..., 0])


def _cameras(K: Any, images: tuple[Any, Any], photos: list[np.ndarray]) -> list[np.ndarray]:
    """Return the camera matrices: given, from the EXIF data, or guessed."""
    from cvkern.geometry._matrices import check_cameras
    from cvkern.images._exif import focal_length

    if K is not None:
        return list(check_cameras(K, 2, "K"))
    cameras, guessed = [], []
    for image, photo, name in zip(images, photos, ("image0", "image1"), strict=True):
        height, width = photo.shape[:2]
        is_file = isinstance(image, (str, os.PathLike))
        focal = focal_length(Path(image), photo.shape) if is_file else None
        if focal is None:
            focal = LONG_SIDES * max(height, width)
            guessed.append(f"{name} ({focal:.0f} pixels)")
        cameras.append(
            np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
        )
    if guessed:
        warn(f"the focal length is guessed of {' and '.join(guessed)}: give K")
    return cameras


def _reduced(photo: np.ndarray, K: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    from cvkern.transform import resize

    height, width = photo.shape[:2]
    share = most / max(height, width)
    if share >= 1:
        return photo, K
    shape = max(round(share * height), 1), max(round(share * width), 1)
    small = resize(photo, shape, channel_axis=-1 if photo.ndim == 3 else None)
    x, y = shape[1] / width, shape[0] / height
    scale = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
    return np.rint(small).clip(0, 255).astype(np.uint8), scale @ K


def _matches(
    photos: list[np.ndarray], max_keypoints: int, max_ratio: float
) -> tuple[np.ndarray, np.ndarray]:
    from cvkern.features import match_descriptors, sift
    from cvkern.images.colors import luma

    grays = [luma(p).round().astype(np.uint8) if p.ndim == 3 else p for p in photos]
    one, other = (sift(gray, max_keypoints) for gray in grays)
    pairs = match_descriptors(one.descriptors, other.descriptors, max_ratio)
    a, b = one.points[pairs[:, 0]], other.points[pairs[:, 1]]
    return np.asarray(a, np.float64), np.asarray(b, np.float64)


def _geometry(
    a: np.ndarray, b: np.ndarray, cameras: np.ndarray, known: bool, threshold: float, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return F, the matches that agree with it and are before both cameras, and the pose."""
    from cvkern import geometry

    first, second = cameras
    if known:
        fit = geometry.find_essential(a, b, first, second, threshold, seed=seed)
    else:  # rows meet, whatever the focal length is
        fit = geometry.find_fundamental(a, b, threshold, seed=seed)
    found = int(np.sum(fit.inliers))
    kept = fit.inliers if fit.matrix is not None else slice(None)
    _refuse_turns(a[kept], b[kept], cameras, known, threshold, seed)
    if fit.matrix is None or found < LEAST:
        raise ValueError(
            f"image0 and image1 must have at least {LEAST} matches of one geometry, got {found} "
            f"of {len(a)}"
        )
    a, b = a[fit.inliers], b[fit.inliers]
    if known:
        essential = fit.matrix
        f = np.linalg.inv(second).T @ essential @ np.linalg.inv(first)
    else:
        f = fit.matrix
        essential = geometry.essential_from_fundamental(f, first, second)
    pose = geometry.recover_pose(essential, a, b, first, second)
    front = pose.inliers
    return f, a[front], b[front], pose.rotation, pose.translation


def _refuse_turns(
    a: np.ndarray, b: np.ndarray, cameras: np.ndarray, known: bool, threshold: float, seed: int
) -> None:
    """Refuse matches of one map: those of a turned camera, or of a plane before unknown cameras."""
    from cvkern.geometry import find_homography
    from cvkern.geometry._matrices import nearest_rotations

    fit = find_homography(a, b, threshold, seed=seed)
    share = float(np.mean(fit.inliers)) if fit.matrix is not None else 0.0
    if share < FLAT:
        return
    rays = [_rays(points, camera) for points, camera in zip((a, b), cameras, strict=True)]
    one, other = (r / np.linalg.norm(r, axis=1, keepdims=True) for r in rays)
    turned = one @ nearest_rotations(other.T @ one).T
    gaps = turned[:, :2] / turned[:, 2:] - rays[1][:, :2]
    if known and np.median(np.linalg.norm(gaps, axis=1)) * cameras[1][0, 0] > threshold:
        return  # a plane, seen from two places
    raise ValueError(
        f"image0 and image1 must show a scene with depth from two places: {share:.0%} of their "
        "matches fit one map, as of a camera that only turned" + (", or of a plane" * (not known))
    )


def _rectified(
    a: np.ndarray, b: np.ndarray, f: np.ndarray, photos: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    from cvkern.geometry import rectify_uncalibrated
    from cvkern.images._overlay import canvas
    from cvkern.transform import warp_perspective

    shapes = [p.shape[:2] for p in photos]
    try:
        H0, H1 = rectify_uncalibrated(a, b, f, shapes)
    except ValueError as error:
        raise ValueError(
            f"image0 and image1 must be taken side by side to be rectified: {error}"
        ) from error
    warped = [
        warp_perspective(p, h, shapes[0], channel_axis=-1 if p.ndim == 3 else None, dtype=np.uint8)
        for p, h in zip(photos, (H0, H1), strict=True)
    ]
    if warped[0].ndim != warped[1].ndim:  # one is grey
        warped = [canvas(w) for w in warped]
    return H0, H1, warped


def _dense(
    warped: list[np.ndarray], sparse: np.ndarray, depths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Match both pictures pixel by pixel; return disparities, and where they are from a match."""
    # Near points must have the larger disparity, or both pictures must be mirrored for matching.
    near = 1 / depths - np.mean(1 / depths)
    mirrored = bool((near * (sparse - sparse.mean())).sum() < 0)
    sign, step = (-1, slice(None, None, -1)) if mirrored else (1, slice(None))
    low, high = np.quantile(sign * sparse, (SHARE, 1 - SHARE))
    margin = max(MARGIN * (high - low), LEAST_MARGIN)
    span = int(np.floor(low - margin)), int(np.ceil(high + margin)) + 1
    if span[1] - span[0] > MOST_DISPARITIES:
        raise ValueError(
            f"image0 and image1 must have at most {MOST_DISPARITIES} disparities, got "
            f"{span[1] - span[0]}: a smaller max_side has fewer"
        )
    axis = -1 if warped[0].ndim == 3 else None
    one, other = (np.ascontiguousarray(w[:, step]) for w in warped)
    found = stereo_match(one, other, span, channel_axis=axis)
    return sign * found.disparity[:, step], found.valid[:, step]


def _space(
    disparity: np.ndarray, maps: tuple[np.ndarray, np.ndarray], cameras: np.ndarray,
    rotation: np.ndarray, translation: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the point of each pixel, (H, W, 3) of the first camera."""
    rows, columns = np.indices(disparity.shape, np.float64)
    rays = []
    for matrix, camera, x in zip(maps, cameras, (columns, columns - disparity), strict=True):
        back = np.linalg.inv(camera) @ np.linalg.inv(matrix)
        ray = np.stack((x, rows, np.ones_like(rows)), -1).reshape(-1, 3) @ back.T
        rays.append(ray / ray[:, 2:])
    depths = _depths(rays[0], rays[1], rotation, translation)
    return (depths[:, None] * rays[0]).reshape(*disparity.shape, 3)


def _rays(points: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Return directions (x, y, 1) of points (row, column)."""
    rays = np.c_[points[:, ::-1], np.ones(len(points))] @ np.linalg.inv(camera).T
    return rays / rays[:, 2:]


def _depths(
    rays0: np.ndarray, rays1: np.ndarray, rotation: np.ndarray, translation: np.ndarray
) -> np.ndarray:
    """Return z that solves (z R ray0 + t) x ray1 = 0 in least squares; <= 0 behind a camera."""
    turned = rays0 @ rotation.T
    across, along = np.cross(turned, rays1), np.cross(translation, rays1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = -(across * along).sum(axis=1) / (across**2).sum(axis=1)
    behind = depths * turned[:, 2] + translation[2] <= 0
    return np.where(behind & (depths > 0), -depths, depths)


def _mapped(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    q = np.c_[points[:, ::-1], np.ones(len(points))] @ matrix.T
    return q[:, 1::-1] / q[:, 2:]


def _inside(matrix: np.ndarray, shape: tuple[int, ...], size: tuple[int, ...]) -> np.ndarray:
    """Tell which pixels of a rectified picture the photograph shows."""
    rows, columns = np.indices(size, np.float64)
    y, x = _mapped(np.linalg.inv(matrix), np.stack((rows.ravel(), columns.ravel()), 1)).T
    known = (x >= 0) & (y >= 0) & (x <= shape[1] - 1) & (y <= shape[0] - 1)
    return known.reshape(size)
