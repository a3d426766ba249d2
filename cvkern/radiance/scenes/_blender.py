"""Scenes of Blender (``transforms_<split>.json``) and instant-ngp (``transforms.json``)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._notices import warn
from cvkern.radiance.pinhole import Cameras, cameras
from cvkern.radiance.scenes._masks import read_masks
from cvkern.radiance.scenes.photographs import (
    Bounds,
    Scene,
    every,
    focus_of,
    read_images,
    refuse_outside,
    shrunk,
)

SPLITS = ("train", "val", "test")
# The synthetic scenes are in a cube of side 3; their cameras are at distance 4 from its middle.
BLENDER_HALF, BLENDER_AWAY, BLENDER_NEAR, BLENDER_FAR = 1.5, 4.0, 2.0, 6.0
UNLIKE = 0.25  # difference from these, as a share, from which a scene has units of its own
DEPTH_RANGE = 8.0  # depth of a value v is 8 (1 - v / 255), with 65535 for 16-bit pictures
# By default, instant-ngp maps the world to its unit cube by this scale, then this offset.
NGP_SCALE, NGP_OFFSET = 0.33, 0.5
NEAREST = 0.05  # distance of the first sample, as a share of half the side of a cube
PAST = 0.1  # largest share of cameras that may look past the cube
LENSES = "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"
SUFFIXES = ("", ".png", ".jpg", ".jpeg")
TURN = np.diag([1.0, -1.0, -1.0])  # from OpenGL's axes to OpenCV's


def load(file: Path, test_every: int, outside: bool) -> Scene:
    """Read a scene; see :func:`cvkern.radiance.load_scene`."""
    if file.stem.removeprefix("transforms_") not in SPLITS:
        return _instant_ngp(file, test_every, outside)
    parts = [(s, file.with_name(f"transforms_{s}.json")) for s in SPLITS]
    parts = [(split, part) for split, part in parts if part.exists() and split != "val"]
    files, masks, poses, held, lenses = [], [], [], [], []
    for split, part in parts:
        content = _content(part)
        for number, frame in enumerate(content["frames"]):
            files.append(_photograph(part, frame, number, outside))
            masks.append(_mask(part, frame, number, outside))
            poses.append(pose_of(part, frame, number))
            held.append(split == "test")
        lenses += [(part, content)] * len(content["frames"])
    images = read_images(files)
    height, width = images.shape[1:3]
    intrinsics = [lens_of(part, content, width, height)[0] for part, content in lenses]
    views = cameras_of(file, poses, np.array(intrinsics), width, height)
    bounds, near, far = _synthetic(views)
    depths, seen = _depths(files, height, width), read_masks(masks, height, width)
    return Scene(images, views, np.array(held), bounds, near, far, depths, seen)


def _synthetic(views: Cameras) -> tuple[Bounds, float, float]:
    """Return the cube and the range of the synthetic scenes, or those of other units."""
    bounds, away = _seen(views)
    apart = float(np.abs(bounds.center).max()) / BLENDER_HALF
    if max(abs(away / BLENDER_AWAY - 1), apart) > UNLIKE and bounds.half > 0:
        return bounds, NEAREST * bounds.half, math.inf
    return Bounds((0.0, 0.0, 0.0), BLENDER_HALF, False), BLENDER_NEAR, BLENDER_FAR


def _seen(views: Cameras) -> tuple[Bounds, float]:
    """Return the cube that the cameras see, and their distance from its middle.

    It is as large as the field of view at the point that all cameras look at.
    """
    point = focus_of(views.poses)
    away = np.linalg.norm(views.poses[:, :, 3] - point, axis=1)
    sizes = np.array([views.width, views.height]) / 2
    half = float(np.median(away * (sizes / views.intrinsics[:, :2]).max(axis=1)))
    x, y, z = map(float, point)
    return Bounds((x, y, z), half, False), float(np.median(away))


def _instant_ngp(file: Path, test_every: int, outside: bool) -> Scene:
    content = _content(file)
    frames = content["frames"]
    order = sorted(range(len(frames)), key=lambda i: str(frames[i].get("file_path")))
    frames = [frames[i] for i in order]
    images = read_images([_photograph(file, frame, i, outside) for i, frame in enumerate(frames)])
    height, width = images.shape[1:3]
    masks = [_mask(file, frame, i, outside) for i, frame in enumerate(frames)]
    lenses = [lens_of(file, content | frame, width, height) for frame in frames]
    poses = [pose_of(file, frame, i) for i, frame in enumerate(frames)]
    if any("split" in frame for frame in frames):
        held = np.array([frame.get("split") == "test" for frame in frames])
    else:
        held = every(len(frames), test_every)
    views = cameras_of(
        file, poses, np.array([a for a, _ in lenses]), width, height,
        np.array([b for _, b in lenses]),
    )  # fmt: skip
    bounds, near = _cube(file, content, views)
    way_out = "give other bounds, or remove aabb_scale, scale and offset from the file"
    warn_of_past(views, bounds, f"{file}: ", way_out)
    seen = read_masks(masks, height, width)
    return Scene(images, views, held, bounds, near, math.inf, masks=seen)


def _cube(file: Path, content: dict[str, Any], views: Cameras) -> tuple[Bounds, float]:
    """Return the cube of a file, or one from its cameras, and the distance of the first sample."""
    if all(content.get(name) is None for name in ("aabb_scale", "scale", "offset")):
        bounds = _seen(views)[0]
        if bounds.half > 0:
            return bounds, NEAREST * bounds.half
    scale = number_of(file, content, "scale", NGP_SCALE, 0.0)
    half = 0.5 * number_of(file, content, "aabb_scale", 1.0, 0.0) / scale
    offset = content.get("offset", NGP_OFFSET)
    offset = offset if isinstance(offset, list) and len(offset) == 3 else [offset] * 3
    moved = [number_of(file, {"offset": o}, "offset", NGP_OFFSET) for o in offset]
    x, y, z = ((0.5 - o) / scale for o in moved)
    return Bounds((x, y, z), half, False), NEAREST / scale


def warn_of_past(views: Cameras, bounds: Bounds, where: str, way_out: str) -> None:
    """Warn if the optical axes of many cameras miss the cube."""
    eyes = (views.poses[:, :, 3] - np.array(bounds.center)) / bounds.half
    ahead = views.poses[:, :, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack(((-1 - eyes) / ahead, (1 - eyes) / ahead))
    enter, leave = np.fmin(*sides).max(axis=1), np.fmax(*sides).min(axis=1)
    past = float(np.mean(~((enter <= leave) & (leave > 0))))
    if past > PAST:
        warn(
            f"{where}{past:.0%} of the cameras look past the scene's cube, of half side "
            f"{bounds.half:g} about {bounds.center}: photographs show things outside of it; "
            f"{way_out}"
        )


def _content(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))  # a byte order mark is optional
    except RecursionError:
        raise ValueError(f"{file} must be JSON: it is nested too deeply") from None
    except OSError as error:
        raise ValueError(f"{file} must be a file that can be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{file} must be JSON: {error}") from None
    frames = content.get("frames") if isinstance(content, dict) else None
    if not frames:
        raise ValueError(f"{file} must have frames, got none")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise ValueError(f"{file} must have a list of objects as frames, got {frames!r:.80}")
    return content


def number_of(
    file: Path, content: dict[str, Any], name: str, default: float, above: float = -math.inf
) -> float:
    """Return the number called `name`, if the file has it."""
    value = content.get(name)
    if value is None:
        return default
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not above < found < math.inf:
        rule = "a finite number" if above else "a finite number > 0"
        raise ValueError(f"{file} must give {rule} for {name}, got {value!r:.80}")
    return found


def _mask(file: Path, frame: dict[str, Any], number: int, outside: bool) -> Path | None:
    """Return the mask of a frame, if it has one."""
    if frame.get("mask_path") is None:
        return None
    return _photograph(file, frame, number, outside, "mask_path")


def _photograph(
    file: Path, frame: dict[str, Any], number: int, outside: bool, key: str = "file_path"
) -> Path:
    name = frame.get(key)
    if not isinstance(name, str):
        raise ValueError(f"{file} must give {key} for each frame, got {name!r} in {number}")
    if not outside:
        refuse_outside(file, name, number)
    stem = file.parent / name
    for suffix in SUFFIXES:
        try:
            found = stem.with_name(stem.name + suffix)
            there = found.is_file()
        except (OSError, ValueError) as error:  # a name that is too long or contains a zero byte
            raise ValueError(
                f"{file} must give {key} for each frame, got {name!r:.80} in {number}: {error}"
            ) from None
        if there:
            return found
    raise FileNotFoundError(f"scene must have all its photographs, but {stem} is missing")


def pose_of(file: Path, frame: dict[str, Any], number: int) -> np.ndarray:
    try:
        pose = np.array(frame["transform_matrix"], np.float64)
    except (KeyError, TypeError, ValueError, OverflowError):
        pose = np.empty(0)
    if pose.shape not in ((3, 4), (4, 4)):
        raise ValueError(
            f"{file} must give a transform_matrix of 4 x 4 for each frame, "
            f"got shape {pose.shape} in {number}"
        )
    pose = pose[:3]
    if not np.isfinite(pose).all():
        raise ValueError(f"{file} must give finite poses, got {pose.tolist()} in {number}")
    # Some writers scale the rotation, so normalise the axes.
    lengths = np.linalg.norm(pose[:, :3], axis=0)
    turn = pose[:, :3] / np.where(lengths > 0, lengths, 1)
    return np.concatenate((turn @ TURN, pose[:, 3:]), axis=1)


def lens_of(
    file: Path, lens: dict[str, Any], width: int, height: int
) -> tuple[list[float], list[float]]:
    """Return fx, fy, cx, cy and the distortion for the actual size of the images."""
    model = "fisheye" if lens.get("is_fisheye") else lens.get("camera_model", "OPENCV")
    if model not in LENSES:
        raise ValueError(f"{file} must use one of {LENSES}, got {model}")

    def number(name: str, default: float, above: float = -math.inf) -> float:
        return number_of(file, lens, name, default, above)

    wide, high = number("w", width, 0.0), number("h", height, 0.0)
    fx = number("fl_x", math.nan, 0.0)
    if math.isnan(fx):
        angle = number("camera_angle_x", math.nan)
        if not 0 < angle < math.pi:
            raise ValueError(f"{file} must give fl_x, or camera_angle_x in (0, pi), got {angle}")
        fx = 0.5 * wide / math.tan(0.5 * angle)
    angle = number("camera_angle_y", 0.0)
    fy = number("fl_y", 0.5 * high / math.tan(0.5 * angle) if angle else fx, 0.0)
    across, down = shrunk(width, height, wide, high, file)
    # These files measure from the corner of the first pixel.
    cx, cy = number("cx", 0.5 * wide) * across - 0.5, number("cy", 0.5 * high) * down - 0.5
    bent = [number(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")]
    return [fx * across, fy * down, cx, cy], bent


def cameras_of(
    file: Path,
    poses: list[np.ndarray],
    intrinsics: np.ndarray,
    width: int,
    height: int,
    distortion: Any = 0.0,
) -> Cameras:
    try:
        return cameras(np.stack(poses), intrinsics, width, height, distortion=distortion)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def _depths(files: list[Path], height: int, width: int) -> np.ndarray | None:
    """Read the depth pictures beside the photographs, if there are any."""
    from cvkern.images.files import read_image

    depths = np.full((len(files), height, width), np.nan, np.float32)
    for depth, file in zip(depths, files, strict=True):
        beside = next(iter(sorted(file.parent.glob(f"{file.stem}_depth*.png"))), None)
        if beside is not None:
            shown = read_image(beside)
            values = shown if shown.ndim == 2 else shown[..., 0]
            if values.shape != depth.shape:
                raise ValueError(f"{beside} must be {depth.shape}, got {values.shape}")
            most = np.iinfo(values.dtype).max
            depth[...] = np.where(values > 0, DEPTH_RANGE * (1 - values / most), np.nan)
    return depths if np.isfinite(depths).any() else None
