"""What a reconstruction is: cameras, points, and which camera sees which point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cvkern._checks import as_array, as_numbers
from cvkern.geometry.cameras.lens import Camera, focal_and_center

COUNTED = ("points", "tracks")  # arrays whose lengths others have


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Photographs with their places in the world, and points of the scene.

    The unit of length is free: the cameras' root mean square distance from their mean is 1. The
    origin is the median of the points, and the z axis points up if the cameras were held upright.
    """

    names: tuple[str, ...]
    """Names of all N photographs."""
    poses: np.ndarray
    """Camera to world, (N, 3, 4) float64; NaN for photographs that could not be placed."""
    lenses: tuple[Camera, ...]
    """The cameras with their lenses; photographs of one camera share one."""
    lens_of: np.ndarray
    """Index of the lens of each photograph, (N,) int64."""
    points: np.ndarray
    """(P, 3) float64, in the world."""
    colors: np.ndarray
    """(P, 3) uint8."""
    tracks: np.ndarray
    """Which photograph shows which point, (O, 2) int32: the point, then the photograph; sorted."""
    places: np.ndarray
    """Row and column of each of these, (O, 2) float64."""
    errors: np.ndarray
    """Mean distance of the places of a point from where it is projected, (P,) float64, pixels."""
    others: tuple[Reconstruction, ...] = ()
    """Further models, each in a world of its own, the largest first: of photographs that have no
    place in this one. Only with ``models='all'``."""

    def __repr__(self) -> str:
        return (
            f"Reconstruction({len(self.placed)} of {len(self.names)} photographs, "
            f"{len(self.points)} points)"
        )

    @property
    def placed(self) -> np.ndarray:
        """Indices of the photographs that have a place, ascending."""
        return np.flatnonzero(np.isfinite(self.poses[:, 0, 0]))

    @property
    def unplaced(self) -> tuple[str, ...]:
        """Names of the photographs that could not be placed."""
        there = set(self.placed.tolist())
        return tuple(name for i, name in enumerate(self.names) if i not in there)

    @property
    def cameras(self) -> Any:
        """The placed photographs as :class:`cvkern.radiance.Cameras`, in their order.

        Raises
        ------
        ValueError
            If none is placed, or the photographs differ in size.
        """
        from cvkern.radiance.pinhole import cameras

        used = [self.lenses[n] for n in self.lens_of[self.placed]]
        if not used:
            raise ValueError("reconstruction must have a placed photograph, got none")
        shapes = {lens.shape for lens in used}
        if len(shapes) > 1:
            raise ValueError(f"photographs must have one size, got {sorted(shapes)}")
        ((height, width),) = shapes
        intrinsics = [focal_and_center(lens.matrix) for lens in used]
        distortion = np.stack([lens.distortion for lens in used])
        poses = self.poses[self.placed]
        return cameras(poses, intrinsics, width, height, distortion=distortion)

    def scene(self, images: Any, *, test_every: int = 8) -> Any:
        """Return the placed photographs as a scene for radiance fields.

        Parameters
        ----------
        images : sequence of arrays of shape (H, W, 3) or (H, W, 4), uint8
            All N photographs, as they were given to :func:`reconstruct`.
        test_every : int, default 8
            Hold out one in this many photographs for testing, 0 for none.

        Returns
        -------
        cvkern.radiance.Scene
            Its bounds are guessed as for scenes of COLMAP.

        Raises
        ------
        TypeError
            If the images are not uint8.
        ValueError
            If they are not as many as the names, or as :attr:`cameras` says.
        """
        from cvkern._checks import check_integer
        from cvkern.radiance.scenes._colmap import _extent
        from cvkern.radiance.scenes.photographs import Scene, every

        test_every = check_integer(test_every, "test_every", 0, 2**31 - 1)
        if len(images) != len(self.names):
            raise ValueError(f"images must be {len(self.names)}, got {len(images)}")
        seen = self.cameras
        chosen = np.stack([np.asarray(images[i]) for i in self.placed])
        bounds, near, far = _extent(seen.poses, self.points)
        return Scene(chosen, seen, every(len(chosen), test_every), bounds, near, far)

    def picture(self, side: int = 600) -> np.ndarray:
        """Draw the points in their colours, and the cameras as pyramids, seen from above.

        Parameters
        ----------
        side : int, default 600
            Rows and columns of the picture.

        Returns
        -------
        array of shape (side, side, 3), uint8

        Raises
        ------
        TypeError
            If `side` is not an integer.
        ValueError
            If `side` is not in [16, 8192].
        """
        from cvkern._checks import check_integer
        from cvkern.images.drawing import draw_lines

        side = check_integer(side, "side", 16, 8192)
        drawn = np.full((side, side, 3), 255, np.uint8)
        placed = self.placed
        if not len(placed):
            return drawn
        eyes = self.poses[placed, :, 3]
        # The picture has the cameras, and nine of ten points.
        low, high = eyes.min(axis=0), eyes.max(axis=0)
        if len(self.points):
            near, far = np.quantile(self.points, (0.05, 0.95), axis=0)
            low, high = np.minimum(low, near), np.maximum(high, far)
        middle, half = (low + high) / 2, 0.5 * float(np.linalg.norm(high - low)) or 1.0
        # Oblique: x to the right, y into the picture, z up.
        down = np.array([[0.0, -0.6, -0.8], [1, 0, 0]])

        def at(points: np.ndarray) -> np.ndarray:
            return (points - middle) @ down.T * (side / 2 / half) + side / 2

        order = np.argsort(-self.points[:, 1], kind="stable")
        place = np.round(at(self.points[order])).astype(int)
        inside = ((place >= 0) & (place < side - 1)).all(axis=1)
        row, column = place[inside].T
        for k in range(4):  # two by two pixels a point
            drawn[row + k // 2, column + k % 2] = self.colors[order][inside]
        lines = []
        for pose, n in zip(self.poses[placed], self.lens_of[placed], strict=True):
            camera = self.lenses[n]
            wide, tall = (0.08 * half * s / max(camera.shape) for s in camera.shape[::-1])
            corners = np.array([[-wide, -tall], [wide, -tall], [wide, tall], [-wide, tall]])
            ahead = np.concatenate((corners, np.full((4, 1), 0.1 * half)), axis=1)
            frame = at(ahead @ pose[:, :3].T + pose[:, 3])
            eye = at(pose[None, :, 3])[0]
            for k in range(4):
                lines += [[*eye, *frame[k]], [*frame[k], *frame[k - 1]]]
        return draw_lines(drawn, np.array(lines), color=(200, 60, 20), width=1.0)


def levelled(poses: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (M, 3, 4) and points (P, 3) in a world with z up, of the size of one."""
    eyes = poses[:, :, 3]
    up = -poses[:, :, 1].mean(axis=0)  # the cameras' y axes point down
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else np.array([0.0, 0.0, 1.0])
    ahead = poses[:, :, 2].mean(axis=0)
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.eye(3)[int(np.argmin(np.abs(up)))]
        ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    turn = np.stack((np.cross(ahead, up), ahead, up))
    middle = np.median(points, axis=0) if len(points) else eyes.mean(axis=0)
    spread = float(np.sqrt(((eyes - eyes.mean(axis=0)) ** 2).sum(axis=1).mean()))
    scale = 1 / spread if spread > 0 else 1.0
    turned = turn @ poses[:, :, :3]
    moved = scale * (eyes - middle) @ turn.T
    return np.concatenate((turned, moved[:, :, None]), axis=2), scale * (points - middle) @ turn.T


def checked(made: Reconstruction) -> Reconstruction:
    """Return a reconstruction with arrays of the class's shapes and dtypes, or refuse it."""
    arrays = [as_array(getattr(made, field), f"reconstruction.{field}") for field in COUNTED]
    views, count, seen = len(made.names), *(np.shape(array)[:1] for array in arrays)
    fields = {
        "poses": ((views, 3, 4), np.float64),
        "lens_of": ((views,), np.int64),
        "points": ((*count, 3), np.float64),
        "colors": ((*count, 3), np.uint8),
        "tracks": ((*seen, 2), np.int32),
        "places": ((*seen, 2), np.float64),
        "errors": (count, np.float64),
    }
    limits = {"lens_of": len(made.lenses), "colors": 256, "tracks": (*count, views)}
    found = {}
    for field, (shape, dtype) in fields.items():
        values = as_numbers(getattr(made, field), f"reconstruction.{field}")
        if values.shape != shape:
            raise ValueError(f"reconstruction.{field} must have shape {shape}, got {values.shape}")
        if not np.isfinite(values).all() and field != "poses":
            raise ValueError(f"reconstruction.{field} must be finite, got others")
        if field in limits and not ((values >= 0) & (values < limits[field])).all():
            limit = limits[field]
            raise ValueError(f"reconstruction.{field} must be at least 0 and below {limit}")
        found[field] = values.astype(dtype)
    return replace(made, **found)
