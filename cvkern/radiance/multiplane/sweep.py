"""A plane sweep: from posed photographs to the first texels of planes."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry.cameras.lens import matrix_of
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.fields.planes import LEAST, MOST, PlanesField, Reference
from cvkern.radiance.multiplane.layering import extend, opacities
from cvkern.radiance.pinhole import Cameras, pixel_rays
from cvkern.radiance.scenes.photographs import Scene

ASIDE = 60.0  # degrees that a photograph may look aside from the middle of all
WIDEST = math.tan(math.radians(65))  # half of the planes' side, in units of their depth
VIEWS = 4  # photographs whose pairs are compared
PIXELS = 30_000  # most pixels of a compared photograph
STEPS = 16, 128  # planes of the sweep
STEP = 2.0  # pixels that two neighbouring planes of the sweep are apart, at most
SHIFT = 0.5  # share of the image side that the nearest plane may be shifted
P1, P2, UNKNOWN = 10, 60, 31  # penalties of semi-global matching, and the cost of unseen pixels
SURE = 0.05  # confidence of pixels that decide on the range of depths
TAILS = 2.0, 98.0  # percentiles of the inverse depths of these pixels
MARGIN = 0.1  # share of the range that is added at each end
BEHIND = 0.1  # share of the longer side by which planes go on behind nearer surfaces
FAINT, SOLID = 0.005, 0.95  # opacities that training begins with
DARK = 0.01  # least distance of first colours from 0 and 1


class Sweep(NamedTuple):
    """Inverse depths of the texels of a coarse reference camera."""

    lens: np.ndarray
    """fx, fy, cx, cy."""
    disparity: np.ndarray
    """(H, W) float64."""
    sure: np.ndarray
    """Whether the photographs agree, (H, W) bool."""


class Lattice(NamedTuple):
    """The texels of a reference camera."""

    lens: np.ndarray
    """fx, fy, cx, cy, (4,) float64."""
    shape: tuple[int, int]
    """Rows and columns."""


def first_planes(scene: Scene, frame: Frame, settings: PlanesField) -> tuple[Reference, np.ndarray]:
    """Return the reference camera, and first parameters (D, H, W, 4) of its planes."""
    used = np.flatnonzero(~scene.test)
    cameras = scene.cameras.select(used)
    poses = frame.inside(cameras.poses).astype(np.float64)
    pose = middle_pose(poses)
    half = frame.bounds.half
    near, far = (None if d is None else half / d for d in (settings.near, settings.far))
    span = (
        1 / frame.far if far is None else far,
        near if near is not None else 1 / frame.near if frame.near > 0 else math.inf,
    )
    if span[0] >= span[1]:
        raise ValueError(f"near must be below far, got {half / span[1]:g} and {half / span[0]:g}")
    chosen = _spread(poses, pose)
    none = np.zeros(len(chosen), bool)
    few = replace(
        scene, images=scene.images[used[chosen]], cameras=cameras.select(chosen), test=none,
        depths=None,
    )  # fmt: skip
    found = _sweep(few, frame, pose, span)
    values = found.disparity[found.sure] if found.sure.any() else found.disparity.ravel()
    least, most = np.percentile(values, TAILS)
    spare = MARGIN * (most - least) + 1e-3 * most
    least = max(least - spare, span[0]) if far is None else far
    most = min(most + spare, span[1]) if near is None else near
    disparities = np.linspace(most, least, settings.planes)
    if settings.planes == 1:
        disparities = np.array([float(np.median(values))])
    focal = settings.detail * float(np.median(cameras.intrinsics[:, :2]))
    lens, shape = _lattice(cameras, poses, pose, (least, most), focal, settings)
    reference = Reference(pose, lens, disparities)
    places = _places(found, reference, shape)
    opacity = opacities(places, settings.planes)
    extend(opacity, places, round(BEHIND * max(shape)))
    opacity[-1] = 1.0
    views, parameters = _Views(few, frame), np.empty((*opacity.shape, 4), np.float32)
    for k, q in enumerate(disparities):
        color, seen = views.mean(pose, lens, q, shape)
        parameters[k, ..., :3] = color.clip(DARK, 1 - DARK)
        parameters[k, ..., 3] = FAINT + (SOLID - FAINT) * opacity[k] * seen
    return reference, np.log(parameters / (1 - parameters))


def middle_pose(poses: np.ndarray) -> np.ndarray:
    """Return the pose (3, 4) in the middle of poses (N, 3, 4): at the most central one's place.

    Raises
    ------
    ValueError
        If a camera looks too far aside.
    """
    turn = nearest_rotations(poses[:, :, :3].mean(axis=0))
    cosine = poses[:, :, 2] @ turn[:, 2]
    if cosine.min() < math.cos(math.radians(ASIDE)):
        aside = math.degrees(math.acos(max(-1.0, float(cosine.min()))))
        raise ValueError(
            f"scene must be photographed from one side for planes, within {ASIDE:g} degrees of the "
            f"mean direction, got {aside:.0f}: use 'voxel' or 'hash'"
        )
    eyes = poses[:, :, 3]
    middle = np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).argmin()
    return np.column_stack((turn, eyes[middle]))


def _spread(poses: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Choose photographs that are spread over the inner half of the cameras."""
    eyes = poses[:, :, 3]
    away = np.linalg.norm(eyes - pose[:, 3], axis=1)
    inner = np.flatnonzero(away <= max(np.median(away), np.sort(away)[min(2, len(away) - 1)]))
    chosen = [int(inner[away[inner].argmin()])]
    # Each round adds one.
    while len(chosen) < min(VIEWS, len(inner)):
        gaps = np.linalg.norm(eyes[inner, None] - eyes[None, chosen], axis=2).min(axis=1)
        chosen.append(int(inner[gaps.argmax()]))
    return np.array(chosen)


class _Views:
    """Photographs that are warped to planes."""

    def __init__(self, scene: Scene, frame: Frame):
        from cvkern import Camera, undistort

        cameras = scene.cameras
        self.poses = frame.inside(cameras.poses).astype(np.float64)
        self.matrices, self.images = [], []
        shape = cameras.height, cameras.width
        for image, lens, bent in zip(
            scene.images, cameras.intrinsics, cameras.distortion, strict=True
        ):
            matrix = matrix_of(*lens)
            values = image.astype(np.float32) / 255
            shown = np.ones((*shape, 1), np.float32)
            if image.shape[2] == 4:
                values, shown = values[..., :3] * values[..., 3:], values[..., 3:]
            # Premultiplied colours, the opacity, and whether the photograph shows the pixel.
            layers = np.concatenate((values, shown, np.ones_like(shown)), axis=2)
            if bent.any():
                camera = Camera(matrix, bent, shape)
                parts = undistort(layers[..., :4], camera), undistort(layers[..., 4:], camera)
                layers = np.concatenate(parts, axis=2)
            self.matrices.append(matrix)
            self.images.append(layers)

    def to_grey(self) -> None:
        """Keep the brightness, grey where the photograph is transparent, and the visible part."""
        for at, layers in enumerate(self.images):
            grey = layers[..., :3].mean(axis=2) + 0.5 * (layers[..., 4] - layers[..., 3])
            self.images[at] = np.stack((grey.clip(0, 1), layers[..., 4]), axis=2)

    def warped(
        self, view: int, pose: np.ndarray, lens: np.ndarray, disparity: float, shape: Any
    ) -> np.ndarray:
        """Return a photograph as seen on a plane of a reference camera, (H, W, C)."""
        from cvkern import warp_perspective

        turn = self.poses[view, :, :3].T
        # A point of the plane is (s, 1) / q in the reference camera, with s = K^-1 (x, y).
        across = turn @ pose[:, :3]
        across[:, 2] += disparity * (turn @ (pose[:, 3] - self.poses[view, :, 3]))
        back = self.matrices[view] @ across @ np.linalg.inv(matrix_of(*lens))
        if abs(np.linalg.det(across)) < 1e-9:  # the camera is in the plane
            return np.zeros((*shape, self.images[view].shape[2]), np.float32)
        found = warp_perspective(self.images[view], np.linalg.inv(back), shape, channel_axis=-1)
        row, column = np.ogrid[: shape[0], : shape[1]]
        found[back[2, 0] * column + back[2, 1] * row + back[2, 2] <= 0] = 0
        return found

    def mean(
        self, pose: np.ndarray, lens: np.ndarray, disparity: float, shape: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean colour (H, W, 3) on a plane, and the mean opacity, (H, W)."""
        total = np.zeros((*shape, 5), np.float32)
        for view in range(len(self.images)):
            total += self.warped(view, pose, lens, disparity, shape)
        color = total[..., :3] / np.maximum(total[..., 3:4], 1e-6)
        color[total[..., 3] < 1e-3] = 0.5
        unseen = total[..., 4] < 1e-3
        return color, np.where(unseen, 1.0, total[..., 3] / np.maximum(total[..., 4], 1e-3))


def _sweep(scene: Scene, frame: Frame, pose: np.ndarray, span: tuple[float, float]) -> Sweep:
    """Find an inverse depth within `span` for each texel of a coarse reference camera.

    The costs of a plane are those of `cvkern.stereo_cost` between photographs that are warped to
    it: the mean of the better half of the pairs, because surfaces are hidden in some.
    """
    from scipy.ndimage import distance_transform_edt

    import cvkern

    cameras = scene.cameras
    factor = max(1, math.ceil(math.sqrt(cameras.width * cameras.height / PIXELS)))
    scene = scene.resized(factor) if factor > 1 else scene
    views, cameras = _Views(scene, frame), scene.cameras
    focal = float(np.median(cameras.intrinsics[:, :2]))
    apart = np.linalg.norm(views.poses[:, None, :, 3] - views.poses[None, :, :, 3], axis=2).max()
    sides = min(cameras.height, cameras.width)
    low, high = span
    if not math.isfinite(high) or focal * apart * (high - low) > SHIFT * sides:
        high = low + SHIFT * sides / (focal * apart) if apart > 0 else 2 * low
    count = int(np.clip(math.ceil(focal * apart * (high - low) / STEP) + 1, *STEPS))
    settings = PlanesField(texels=PIXELS * 4, planes=1)
    lens, shape = _lattice(cameras, views.poses, pose, (low, low), focal, settings)
    disparities = np.linspace(high, low, count)
    costs = np.full((*shape, count), UNKNOWN, np.uint8)
    numbers = np.zeros(costs.shape, np.uint8)
    views.to_grey()
    pairs = list(itertools.combinations(range(len(views.images)), 2))
    for k, q in enumerate(disparities):
        seen = [views.warped(v, pose, lens, q, shape) for v in range(len(views.images))]
        shown = [s[..., 1] > 0.999 for s in seen]
        grey = [np.round(255 * s[..., 0]).astype(np.uint8) for s in seen]
        found = np.full((len(pairs), *shape), 255, np.uint8)
        for at, (i, j) in enumerate(pairs):
            cost = cvkern.stereo_cost(grey[i], grey[j], (0, 1))[..., 0]
            found[at] = np.where(shown[i] & shown[j], cost, 255)
        if pairs:
            number = (found < 255).sum(axis=0)
            best = np.maximum((number + 1) // 2, 1)
            total = np.cumsum(np.sort(found, axis=0), axis=0, dtype=np.uint16)
            total = np.take_along_axis(total, best[None] - 1, axis=0)[0]
            costs[..., k] = np.where(number > 0, np.round(total / best), UNKNOWN)
            numbers[..., k] = number
    sums = cvkern.aggregate_semi_global(costs, P1, P2)
    winner = cvkern.winner_take_all(sums, subpixel="equiangular")
    smooth = cvkern.median(winner.disparity, 1) if min(shape) > 2 else winner.disparity
    at = np.round(smooth).astype(np.int64)[..., None]
    number = np.take_along_axis(numbers, at, axis=2)[..., 0]
    seen = number > len(pairs) // 2
    sure = seen & (winner.confidence > SURE)
    disparity = high - smooth.astype(np.float64) * ((high - low) / max(count - 1, 1))
    if seen.any():  # elsewhere, the nearest texel that most photographs show is the best guess
        near: Any = distance_transform_edt(~seen, return_distances=False, return_indices=True)
        disparity = disparity[tuple(near)]
    return Sweep(lens, disparity, sure)


def _lattice(
    cameras: Cameras,
    poses: np.ndarray,
    pose: np.ndarray,
    span: tuple[float, float],
    focal: float,
    settings: PlanesField,
) -> Lattice:
    """Return texels for all that the cameras see at these inverse depths."""
    height, width = cameras.height - 1, cameras.width - 1
    outline = [(y * height / 2, x * width / 2) for y in range(3) for x in range(3)]
    low, high = np.full(2, math.inf), np.full(2, -math.inf)
    for view, placed in enumerate(poses):
        _, directions = pixel_rays(cameras, view, outline)
        d = directions @ pose[:, :3]
        o = pose[:, :3].T @ (placed[:, 3] - pose[:, 3])
        s = d[:, :2] / np.maximum(d[:, 2:], 1e-3)
        for q in span:
            at = s + q * (o[:2] - o[2] * s)
            low, high = np.minimum(low, at.min(axis=0)), np.maximum(high, at.max(axis=0))
    low, high = low.clip(-WIDEST, WIDEST), high.clip(-WIDEST, WIDEST)
    area = float(np.prod(high - low)) * focal**2 * settings.planes
    focal *= min(1.0, math.sqrt(settings.texels / max(area, 1e-9)), MOST / (2 * WIDEST * focal))
    columns, rows = (max(LEAST, math.floor(n)) for n in (high - low) * focal)
    middle = 0.5 * (high + low)
    center = 0.5 * np.array([columns - 1, rows - 1]) - focal * middle
    return Lattice(np.array([focal, focal, *center]), (rows, columns))


def _places(found: Sweep, reference: Reference, shape: tuple[int, int]) -> np.ndarray:
    """Return the number of the plane of each texel, with fractions, (H, W) float64."""
    from scipy.ndimage import map_coordinates

    disparities = reference.disparities
    if len(disparities) == 1:
        return np.zeros(shape)
    rows, columns = np.indices(shape, np.float64)
    old, new = found.lens, reference.lens
    at = [
        (n - new[3 - k]) / new[1 - k] * old[1 - k] + old[3 - k]
        for k, n in enumerate((rows, columns))
    ]
    q = map_coordinates(found.disparity, at, order=1, mode="nearest")
    step = disparities[0] - disparities[1]
    return ((disparities[0] - q) / step).clip(0, len(disparities) - 1)
