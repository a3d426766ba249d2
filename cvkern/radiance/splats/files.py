"""Splats as PLY files in the layout that viewers of 3DGS read."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from cvkern._checks import check_instance, check_positive
from cvkern._files import as_path, replacing
from cvkern._runtime import runtime
from cvkern.clouds.ply import comments, read_vertices
from cvkern.kernels.codes.splats import Splats
from cvkern.radiance.fields.field import FARTHEST, Frame
from cvkern.radiance.fields.splats import SplatCloud, SplatField
from cvkern.radiance.models import Model, Training
from cvkern.radiance.pinhole import Cameras, cameras, look_at
from cvkern.radiance.scenes.photographs import Bounds
from cvkern.radiance.splats.starts import TINTS

__all__ = ["load_splats", "write_splats"]

PLACE, NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
SIZES, TURN = tuple(f"scale_{k}" for k in range(3)), tuple(f"rot_{k}" for k in range(4))
MOST = 2**24  # splats of a file
BLUR, THEIRS = "blur", 0.3  # the comment of a file about its `SplatField.blur`; that of others
TAIL = 2.0  # percent of the splats on either side that do not decide on the bounds
NEAR = 0.2  # depth below which other programs do not show splats, in units of the file
SIDE, FOCAL = 512, 600.0  # pixels of the view of a file without cameras


def write_splats(path: str | os.PathLike[str], model: Model) -> None:
    """Write the splats of a model as PLY, in the layout that viewers of 3DGS read.

    Parameters
    ----------
    path : path
        Ends in ``.ply``; an existing file is replaced once the new one is complete.
    model : Model
        A model of a :class:`SplatField`.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    TypeError
        If an argument has the wrong type.
    ValueError
        If the model has no splats, or `path` does not end in ``.ply``.

    Notes
    -----
    A splat has ``x y z``, normals of 0, coefficients of harmonics ``f_dc_`` and, channel by
    channel, ``f_rest_``, ``opacity`` before the logistic function, ``scale_``, the logarithms of
    standard deviations, and the quaternion ``rot_``, w first: float32 in units of the world. The
    light of photographs and the background are not in the file. A comment has
    :attr:`SplatField.blur`, for :func:`load_splats`; other programs add a larger blur of their own.

    Examples
    --------
    >>> from cvkern.radiance import SplatField, fit, load_splats, make_scene, write_splats
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> field = SplatField(splats=64, start="random")
    >>> write_splats("splats.ply", fit(scene, field, steps=2))
    >>> load_splats("splats.ply", scene.cameras).settings.splats
    64
    """
    check_instance(model, Model, "model")
    if as_path(path).suffix.lower() != ".ply":
        raise ValueError(f"path must end in .ply, got {os.fspath(path)!r}")
    if not isinstance(model.field, SplatCloud):
        raise ValueError(f"model must be of a SplatField, got {type(model.settings).__name__}")
    rt, bounds = model.rt, model.frame.bounds
    splats = Splats(*(rt.to_numpy(a) for a in model.field.splats))
    count = len(splats.means)
    rest = np.zeros((count, 0), np.float32)
    if splats.sides.shape[1] > 1:
        rest = splats.sides.reshape(count, -1, 3).transpose(0, 2, 1).reshape(count, -1)
    names = [*PLACE, *NORMAL, *TINTS, *_rest(rest.shape[1]), "opacity", *SIZES, *TURN]
    table = np.concatenate(
        (
            splats.means.astype(np.float64) * bounds.half + np.array(bounds.center),
            np.zeros((count, 3)), splats.colors, rest, splats.opacities,
            splats.scales + np.log(bounds.half), splats.turns,
        ),
        axis=1,
    )  # fmt: skip
    head = ["ply", "format binary_little_endian 1.0", f"comment {BLUR} {model.settings.blur!r}"]
    head.append(f"element vertex {count}")
    head += [f"property float {name}" for name in names]
    with replacing(path) as beside, beside.open("wb") as file:
        file.write("\n".join([*head, "end_header", ""]).encode("ascii"))
        file.write(table.astype("<f4").tobytes())


def load_splats(path: str | os.PathLike[str], cameras: Cameras | None = None) -> Model:
    """Read splats from a PLY file, of :func:`write_splats` or of other programs.

    Parameters
    ----------
    path : path
    cameras : Cameras, optional
        The cameras of the model; by default one that sees all splats, with z upwards.

    Returns
    -------
    Model
        The model, ready to render, on a black background. Its `blur` is 0.3, as in 3DGS, unless
        the file is one of :func:`write_splats`.

    Raises
    ------
    FileNotFoundError
        If there is no file `path`.
    TypeError
        If `cameras` has the wrong type.
    ValueError
        If it is not a PLY file of splats, is damaged, or is cut short; if it has more than 2^24
        splats, harmonics of another degree than 0 to 3, or a number that is not finite.

    Examples
    --------
    >>> from cvkern.radiance import SplatField, fit, load_splats, make_scene, render, write_splats
    >>> scene = make_scene(train=3, test=1, size=16)
    >>> field = SplatField(splats=64, start="random")
    >>> write_splats("splats.ply", fit(scene, field, steps=2))
    >>> render(load_splats("splats.ply"), scene.cameras).color.shape
    (16, 16, 3)
    """
    if cameras is not None:
        check_instance(cameras, Cameras, "cameras")
    table = read_vertices(path)
    names = table.dtype.names or ()
    found = sum(name.startswith("f_rest_") for name in names)
    degrees = {3 * ((d + 1) ** 2 - 1): d for d in range(4)}
    wanted = [*PLACE, *TINTS, *_rest(found), "opacity", *SIZES, *TURN]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ValueError(f"path must be a PLY file of splats, got one without {missing[0]}")
    if found not in degrees or not 0 < len(table) <= MOST:
        raise ValueError(
            f"path must have 1 to {MOST} splats with 0, 9, 24 or 45 f_rest_ properties, got "
            f"{len(table)} with {found}"
        )

    def columns(group: Any) -> np.ndarray:
        return np.stack([table[name] for name in group], axis=1).astype(np.float32)

    count = len(table)
    groups = {"means": PLACE, "turns": TURN, "scales": SIZES, "opacities": ["opacity"],
              "colors": TINTS}  # fmt: skip
    values = {name: columns(group) for name, group in groups.items()}
    values["sides"] = np.zeros((1, 1), np.float32)
    if found:
        rest = columns(_rest(found)).reshape(count, 3, -1)
        values["sides"] = np.ascontiguousarray(rest.transpose(0, 2, 1)).reshape(count, -1)
    for name, of in values.items():
        if not np.isfinite(of).all():
            raise ValueError(f"path must have finite splats, got {name} that are not")
    low, high = np.percentile(values["means"], (TAIL, 100 - TAIL), axis=0).astype(np.float64)
    half = max(0.6 * float((high - low).max()), 1e-3)
    x, y, z = map(float, (low + high) / 2)
    views = _before((x, y, z), half) if cameras is None else cameras
    frame = Frame(
        Bounds((x, y, z), half, True),
        NEAR / half,
        2.0 * FARTHEST,
        1 / float(views.intrinsics[0, 0]),
    )
    values["means"] = ((values["means"] - np.array((x, y, z))) / half).astype(np.float32)
    values["scales"] = values["scales"] - np.float32(np.log(half))
    settings = SplatField(count, degree=degrees[found], blur=_blur(path))
    field = settings.build(runtime(), frame, 0)
    field.become(Splats(**values))
    training = Training(resumable=False)
    return Model(field, settings, "black", np.zeros(3, np.float32), views, 0, training, {})


def _rest(count: int) -> list[str]:
    """Return the names of the coefficients of harmonics that are not constant."""
    return [f"f_rest_{k}" for k in range(count)]


def _blur(path: str | os.PathLike[str]) -> float:
    """Return the variance that a pixel adds to splats."""
    found = [words[1:] for words in map(str.split, comments(path)) if words[:1] == [BLUR]]
    try:
        return check_positive(float(found[0][0]), BLUR) if found else THEIRS
    except (ValueError, IndexError):
        raise ValueError(f"path must have a blur > 0 in its comment, got {found[0]}") from None


def _before(middle: tuple[float, float, float], half: float) -> Cameras:
    """Return a camera that sees a cube."""
    eye = np.array(middle) + half * np.array((0.0, -3.5, 1.0))
    lens = [FOCAL, FOCAL, (SIDE - 1) / 2, (SIDE - 1) / 2]
    return cameras(look_at(eye, np.array(middle)), lens, SIDE, SIDE)
