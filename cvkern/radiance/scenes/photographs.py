"""Posed photographs, from which radiance fields are trained, and their readers."""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_dtype, check_flag, check_integer
from cvkern._files import as_path
from cvkern.radiance.pinhole import Cameras

ONE_WAY = 0.9  # length of the mean of unit vectors that lie within about 35 degrees


class Bounds(NamedTuple):
    """The cube of the world that contains the scene's detail."""

    center: tuple[float, float, float]
    """World position of the middle."""
    half: float
    """Half of the side, in units of the world."""
    unbounded: bool
    """Whether rays continue beyond the cube, to a distant background."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Photographs with their cameras, some of them held out for testing.

    Raises
    ------
    TypeError
        If `images` are not uint8, or `test` or `masks` are not bool.
    ValueError
        If `images`, `test`, `depths` or `masks` do not match the cameras, the bounds have no size,
        or `near` is not below `far`.
    """

    images: np.ndarray
    """Photographs (N, H, W, 3) or, with opacity, (N, H, W, 4), uint8; not premultiplied."""
    cameras: Cameras
    """One view for each image."""
    test: np.ndarray
    """Whether a view is held out, (N,) bool."""
    bounds: Bounds
    near: float
    """Distance from a camera at which rays begin, in units of the world."""
    far: float
    """Distance from a camera at which rays end; may be infinite."""
    depths: np.ndarray | None = None
    """Distance along the rays of the views, (N, H, W) float32; NaN where it is unknown."""
    masks: np.ndarray | None = None
    """Whether a pixel counts, (N, H, W) bool: training ignores the others, as :func:`evaluate`."""

    def __post_init__(self) -> None:
        views = len(self.cameras), self.cameras.height, self.cameras.width
        check_dtype(self.images, np.uint8, "images")
        check_dtype(self.test, np.bool_, "test")
        if self.images.shape not in ((*views, 3), (*views, 4)):
            raise ValueError(
                f"images must have shape {(*views, 3)} or {(*views, 4)}, as the cameras have, got "
                f"{self.images.shape}"
            )
        if self.test.shape != views[:1]:
            raise ValueError(f"test must have shape {views[:1]}, got {self.test.shape}")
        if self.depths is not None and self.depths.shape != views:
            raise ValueError(f"depths must have shape {views}, got {self.depths.shape}")
        if self.masks is not None:
            check_dtype(self.masks, np.bool_, "masks")
            if self.masks.shape != views:
                raise ValueError(f"masks must have shape {views}, got {self.masks.shape}")
        if not (0 < self.bounds.half < np.inf and np.isfinite(self.bounds.center).all()):
            raise ValueError(f"bounds must be finite with half > 0, got {self.bounds}")
        if not 0 <= self.near < self.far:
            raise ValueError(f"near must be >= 0 and below far, got {self.near} and {self.far}")

    def __len__(self) -> int:
        return len(self.images)

    @property
    def footprint(self) -> float:
        """Side of a pixel at the distance of the detail, units of the world; median of the views.

        The distance is that of the middle of the bounds, but at least that of their sides.
        """
        away = np.linalg.norm(self.cameras.poses[:, :, 3] - np.array(self.bounds.center), axis=1)
        return float(np.median(np.maximum(away, self.bounds.half) / self.cameras.intrinsics[:, 0]))

    def resized(self, factor: int) -> Scene:
        """Return the scene with its images averaged over blocks of `factor` x `factor` pixels.

        The depth of a block is that of the pixel at, or next to, its middle. A block counts if all
        of its pixels do.

        Raises
        ------
        TypeError, ValueError
            As :meth:`Cameras.resized`.
        """
        small = self.cameras.resized(factor)
        depths = self.depths
        if depths is not None:
            depths = depths[:, factor // 2 :: factor, factor // 2 :: factor]
            depths = depths[:, : small.height, : small.width]
        images = np.stack([_averaged(image, factor) for image in self.images])
        masks = self.masks
        if masks is not None:
            rows, columns = small.height * factor, small.width * factor
            blocks = masks[:, :rows, :columns]
            masks = blocks.reshape(-1, small.height, factor, small.width, factor).all(axis=(2, 4))
        return replace(self, images=images, cameras=small, depths=depths, masks=masks)


def load_scene(path: Any, *, test_every: int = 8, outside: bool = False) -> Scene:
    """Read a folder of posed photographs.

    Parameters
    ----------
    path : str or Path
        A folder, or the JSON file in it. Its contents decide the format: ``transforms_train.json``
        and similar (Blender), ``transforms.json`` (instant-ngp, with lens distortion),
        ``sparse/0`` or ``cameras.bin`` / ``cameras.txt`` (COLMAP; photographs in ``images``), or
        ``poses_bounds.npy`` (LLFF).
    test_every : int, default 8
        If the format names no test views, every `test_every`-th photograph, beginning with the
        first in order of their names, is held out for testing; 0 for none.
    outside : bool, default False
        Whether a file may name photographs outside its folder.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        If the folder does not exist, is in none of the formats, or names a file that is missing.
    TypeError
        If `test_every` is not an integer.
    ValueError
        If `test_every` is negative; if `path` is another file; if a file is damaged; if there are
        no photographs, or they differ in size, or have other proportions than their lens; if a
        number is not finite; if a pose contains no rotation; if a photograph is outside the folder;
        or if the lens model is unknown, as for a fisheye. The message names the file.

    Warns
    -----
    UserWarning
        If cameras look past the cube of a ``transforms.json``.

    Notes
    -----
    Photographs are read as they are stored, and an EXIF orientation is ignored, because the cameras
    were computed from the stored pixels.

    Bounds are guesses, except for a ``transforms.json`` with ``aabb_scale``, ``scale`` or
    ``offset``, which define a cube. Without them, the cube is as large as the cameras' field of
    view at the point that they look at. So it is for scenes of Blender, unless the cameras look at
    the origin from a distance of 3 to 5, as in the scenes of the first paper on radiance fields:
    these are within 1.5 of the origin and 2 to 6 from the cameras. Scenes of COLMAP and LLFF are
    unbounded, with a cube that contains the cameras, around the point that they look at. Use
    ``dataclasses.replace(scene, bounds=Bounds(...), near=..., far=...)`` to correct a guess.

    Formats with pixel centres at halves are shifted by half a pixel, and the OpenGL axes (y up, z
    backward) of Blender, instant-ngp and LLFF are converted to those of OpenCV. Lengths stay in the
    unit of the files.

    Masks are pictures of the photographs' size in which the pixels to ignore are dark, below 128:
    ``mask_path`` of a frame in a JSON file, or, for COLMAP and LLFF, ``masks/a.jpg.png`` or
    ``masks/a.png`` for the photograph ``images/a.jpg``.

    A depth picture beside a photograph of a Blender scene shows a distance d as 255 (1 - d / 8),
    and empty space as 0.
    """
    outside = check_flag(outside, "outside")
    test_every = check_integer(test_every, "test_every", 0, 2**31 - 1)
    path = as_path(path)
    if not path.exists():
        raise FileNotFoundError(f"path must be a folder of posed photographs, got {str(path)!r}")
    if path.is_file() and path.suffix.lower() != ".json":
        raise ValueError(
            f"path must be a folder of posed photographs, or the JSON file in it, got {str(path)!r}"
        )
    folder = path if path.is_dir() else path.parent
    formats = (
        ("_blender", path if path.is_file() else folder / "transforms_train.json"),
        ("_blender", folder / "transforms.json"),
        ("_llff", folder / "poses_bounds.npy"),
        *(
            ("_colmap", model / f"cameras.{kind}")
            for model in (folder / "sparse" / "0", folder / "sparse", folder)
            for kind in ("bin", "txt")
        ),
    )
    for name, file in formats:
        if file.exists():
            module = importlib.import_module(f"cvkern.radiance.scenes.{name}")
            more = () if name == "_llff" else (outside,)  # it names no photographs
            return module.load(file, test_every, *more)
    raise FileNotFoundError(
        "path must hold transforms_train.json, transforms.json, poses_bounds.npy or a COLMAP "
        f"model, got {str(path)!r}"
    )


def refuse_outside(file: Path, name: str, number: int) -> None:
    """Refuse the name of a photograph that leads out of the folder that it is in."""
    if Path(name).is_absolute() or ".." in Path(os.path.normpath(name)).parts:
        raise ValueError(
            f"{file} must name photographs in its folder, got {name!r:.80} in {number}: "
            "load_scene(..., outside=True) reads it"
        )


def read_images(files: list[Path]) -> np.ndarray:
    """Read photographs of one size, (N, H, W, 3 or 4) uint8."""
    from cvkern.images.files import read_image

    if not files:
        raise ValueError("scene must have at least one photograph, got none")
    found = []
    for file in files:
        try:
            there = file.exists()
        except OSError as error:  # a name that is too long
            raise ValueError(
                f"scene must name photographs, got {file.name!r:.80}: {error.strerror}"
            ) from None
        if not there:
            raise FileNotFoundError(f"scene must have all its photographs, but {file} is missing")
        image = _as_bytes(
            read_image(file, orient=False), file
        )  # the cameras were fitted to the photograph as it is stored
        if found and image.shape != found[0].shape:
            raise ValueError(
                f"photographs must have one size, got {image.shape} in {file}, "
                f"and {found[0].shape} in {files[0]}"
            )
        found.append(image)
    return np.stack(found)


def shrunk(width: int, height: int, wide: float, high: float, file: Path) -> tuple[float, float]:
    """Return the size of photographs divided by the size that a lens in `file` is for."""
    # Compare to a pixel, because reduced photographs have rounded sizes.
    if not (wide > 0 < high and abs(width * high - height * wide) <= max(wide, high)):
        raise ValueError(
            f"{file} must be for photographs as wide and high as these, {width} x {height}, "
            f"or in proportion, got {wide:g} x {high:g}"
        )
    return width / wide, height / high


def view_directions(poses: np.ndarray) -> np.ndarray:
    """Return the unit vector along which each camera looks, (N, 3)."""
    return poses[:, :, 2]


def focus_of(poses: np.ndarray) -> np.ndarray:
    """Return the point nearest to the optical axes of all cameras, (3,).

    Nearly parallel axes may meet anywhere. So for cameras that look the same way, the point is at
    least as far ahead as the cameras are apart.
    """
    eyes, ahead = poses[:, :, 3], view_directions(poses)
    # The distance from an axis is |(I - d d^T)(p - o)|; solve the least squares over all axes.
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None]
    system = across.sum(axis=0) + 1e-9 * len(poses) * np.eye(3)  # parallel axes have no such point
    wanted = (across @ eyes[:, :, None])[..., 0].sum(axis=0) + 1e-9 * eyes.sum(axis=0)
    point, middle = np.linalg.solve(system, wanted), eyes.mean(axis=0)
    way = ahead.mean(axis=0)
    if np.linalg.norm(way) > ONE_WAY:
        way /= np.linalg.norm(way)
        apart = np.sqrt(((eyes - middle) ** 2).sum(axis=1).mean())
        point += max(0.0, apart - (point - middle) @ way) * way
    return point


def every(count: int, step: int) -> np.ndarray:
    """Mark the first of every `step` views; none if `step` is 0 or there is only one view."""
    marks = np.zeros(count, bool)
    if step and count > 1:
        marks[::step] = True
    return marks


def _as_bytes(image: np.ndarray, file: Path) -> np.ndarray:
    if not np.isfinite(image).all():
        raise ValueError(f"photographs must be finite, got NaN or infinity in {file}")
    if image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    elif image.dtype.kind == "f":
        image = np.round(255 * image.clip(0, 1)).astype(np.uint8)
    elif image.dtype != np.uint8:
        raise ValueError(f"photographs must be uint8, uint16 or float, got {image.dtype} in {file}")
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    if image.shape[2] not in (3, 4):
        raise ValueError(f"photographs must be grey, RGB or RGBA, got {image.shape} in {file}")
    return image


def _averaged(image: np.ndarray, factor: int) -> np.ndarray:
    """Average blocks; colours are weighted by their opacity."""
    height, width = (n // factor for n in image.shape[:2])
    blocks = image[: height * factor, : width * factor].astype(np.float64)
    blocks = blocks.reshape(height, factor, width, factor, -1)
    if image.shape[2] == 3:
        return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)
    opacity = blocks[..., 3:]
    weight = opacity.mean(axis=(1, 3))
    color = (blocks[..., :3] * opacity).mean(axis=(1, 3)) / np.maximum(weight, 1e-9)
    return np.round(np.concatenate((color, weight), axis=2)).astype(np.uint8)
