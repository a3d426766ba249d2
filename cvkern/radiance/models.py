"""Trained radiance fields, with everything needed to render and save them."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_code, check_integer, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.radiance import LIGHT, Background
from cvkern.radiance import checkpoints
from cvkern.radiance.fields.field import Field, Frame
from cvkern.radiance.fields.hash import HashField
from cvkern.radiance.fields.perceptron import MLPField
from cvkern.radiance.fields.planes import PlanesField
from cvkern.radiance.fields.splats import SplatField
from cvkern.radiance.fields.voxel import VoxelField
from cvkern.radiance.march import taken
from cvkern.radiance.pinhole import Cameras, cameras
from cvkern.radiance.scenes.photographs import Bounds
from cvkern.radiance.wild.distractors import DISTRACTORS, patches_of

__all__ = ["Mark", "Model", "load_model"]

MOST_VIEWS, MOST_MARKS = 2**20, 2**24  # rows that a file may have
# The lights of photographs, and how many numbers each has.
APPEARANCES = {"affine": 12, "embedding": LIGHT}
APPEARANCE = "appearance."  # begins the names of the arrays of photographs' lights
TRANSIENT = "transient."  # begins the names of the arrays of what passes
NODES, MOST_NODES = 4, 64  # least distance between nodes, pixels; most along a photograph, about
FIELDS = {
    kind.__name__: kind for kind in (HashField, VoxelField, MLPField, PlanesField, SplatField)
}


class Mark(NamedTuple):
    """The state of a training at one moment."""

    step: int
    """Steps done."""
    seconds: float
    """Time spent in these steps, except the first step of each run."""
    psnr: float
    """Signal-to-noise ratio of a batch at most 16 steps before, decibels; NaN if there is none."""
    test_psnr: float
    """Mean signal-to-noise ratio of held-out views, decibels; NaN if there are none."""
    test_ssim: float
    """Mean structural similarity of the same views; NaN if they are too small."""


@dataclass
class Training:
    """The progress of a training, apart from the field itself."""

    step: int = 0
    seconds: float = 0.0
    rays: int = 0
    """Number of rays in a batch now."""
    total_rays: int = 0
    """Number of rays of all steps."""
    total_samples: int = 0
    """Number of samples of these rays, estimated from one step in 16."""
    progress: float = 0.0
    """Share of the training that was done when the host last checked."""
    marks: list[Mark] = field(default_factory=list)
    stopped: bool = False
    """Whether an interrupt ended it early."""
    resumable: bool = True
    """Whether it can be resumed."""


@dataclass(eq=False)
class Model:
    """A radiance field made from the photographs of a scene.

    :func:`fit` trains a model, :func:`load_model` reads one from a file, and :func:`render` and
    similar functions make pictures of it. Only one thread at a time may use a model.
    """

    field: Field
    """The field, on the device that it was made on."""
    settings: Any
    """The settings of the field, a `HashField`, for example."""
    background: str
    """The background used in training: white, black, random or learnt."""
    behind: np.ndarray
    """The background colour of pictures, (3,) float32; white for random."""
    cameras: Cameras
    """The cameras of the photographs."""
    seed: int
    training: Training
    """The progress of the training; ``training.marks`` is the curve of its quality."""
    extra: dict[str, np.ndarray]
    """The arrays that a resumed training needs in addition to the state of the field."""
    appearance: str | None = None
    """How the light of photographs is modelled: None, 'affine' or 'embedding'."""
    gauge: int = 0
    """The number of the photograph whose light pictures have by default, among ``cameras``."""
    robust: bool = False
    """Whether rays were weighed by how likely they are to show the scene."""
    transient: bool = False
    """Whether what passes in front of photographs was learnt; see :func:`render_transient`."""

    @property
    def appearances(self) -> np.ndarray:
        """The light of each photograph.

        Matrices (A, b) that map colours c to A c + b, (N, 3, 4) float64, one for each of
        ``cameras``: the identity for photographs that the model was not trained on, and for all
        without `appearance`. For an 'embedding', (N, 16) float64 instead: zeros for photographs
        that the model was not trained on.
        """
        if self.appearance == "embedding":
            found = np.zeros((len(self.cameras), LIGHT))
        else:
            found = np.tile(np.eye(3, 4), (len(self.cameras), 1, 1))
        if self.appearance is not None:
            views, values = (self.extra[APPEARANCE + name] for name in ("views", "values"))
            found[views] += values.reshape(-1, *found.shape[1:])
            if APPEARANCE + "gauge" in self.extra:
                found[self.gauge] = np.eye(3, 4) + self.extra[APPEARANCE + "gauge"].reshape(3, 4)
        return found

    @property
    def weights(self) -> np.ndarray:
        """The share of each pixel of the photographs that shows the scene, found by `robust`.

        (N, H, W) float32, one for each of ``cameras``, the same for all pixels of a patch; 1 for
        photographs that the model was not trained on, and for all without `robust`.
        """
        height, width = self.cameras.height, self.cameras.width
        found = np.ones((len(self.cameras), height, width), np.float32)
        if self.robust:
            side, _, _ = patches_of(height, width)
            share = self.extra[DISTRACTORS + "share"]
            wide = share.repeat(side, axis=1).repeat(side, axis=2)[:, :height, :width]
            found[self.extra[DISTRACTORS + "views"]] = wide
        return found

    @property
    def frame(self) -> Frame:
        """The region of the world that the field fills."""
        return self.field.frame

    @property
    def rt(self) -> Runtime:
        """The kernels of the field, ready for this thread."""
        rt = self.field.rt
        rt.start()
        return rt

    def save(self, path: str | os.PathLike[str], *, resumable: bool = True) -> None:
        """Write the model as one ``.npz`` without pickled objects, whole or not at all.

        Parameters
        ----------
        path : path
            Ends in ``.npz``; an existing file is replaced once the new one is complete.
        resumable : bool, default True
            Keep all arrays that a resumed training needs, in full precision. Without, the file is
            six times smaller or more: what pictures need, in half precision, compressed.

        Raises
        ------
        FileNotFoundError
            If the folder of `path` does not exist.
        ValueError
            If `path` has another ending, or is a folder.
        OSError
            If writing fails, on a full disk, for example; the old file stays.
        """
        checkpoints.check_path(path)
        frame, views, training = self.frame, self.cameras, self.training
        header = {
            "field": type(self.settings).__name__,
            "settings": asdict(self.settings),
            "bounds": frame.bounds._asdict(),
            "near": frame.near,
            "far": frame.far,
            "pixel": frame.pixel,
            "background": self.background,
            "seed": self.seed,
            "appearance": self.appearance,
            "gauge": self.gauge,
            "robust": self.robust,
            "transient": self.transient,
            "size": [views.width, views.height],
            "training": asdict(training)
            | {"marks": [], "resumable": resumable and training.resumable},
        }
        arrays = {
            "behind": self.behind,
            "marks": np.array(training.marks, np.float64).reshape(-1, len(Mark._fields)),
            "cameras.poses": views.poses,
            "cameras.intrinsics": views.intrinsics,
            "cameras.distortion": views.distortion,
        }
        self.rt  # noqa: B018  (this thread may not have used the device yet)
        needless = () if resumable else (TRANSIENT + "mean", TRANSIENT + "square")
        kept = {name: a for name, a in self.extra.items() if name not in needless}
        arrays |= {f"extra.{name}": values for name, values in kept.items()}
        state = self.field.state()
        state = state if resumable else self.field.to_render(state)
        arrays |= {f"state.{name}": values for name, values in state.items()}
        checkpoints.write(path, header, arrays, packed=not header["training"]["resumable"])


def load_model(path: str | os.PathLike[str]) -> Model:
    """Read a model that :meth:`Model.save` or :func:`fit` wrote, onto the chosen device.

    Parameters
    ----------
    path : path

    Returns
    -------
    Model
        The model, ready to render. To resume its training, give the file to :func:`fit`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a model, is incomplete or damaged, or has another version; if the shapes of its
        arrays do not match its settings; or if the device does not exist here. Shapes are checked
        before an array is read, so a file takes no more memory than its settings ask for, and
        2^20 views and 2^24 marks.
    """
    runtime()  # report a missing device first, because it is not a fault of the file
    with checkpoints.opened(path) as (header, arrays):
        return _from(header, arrays)


def nodes_of(height: int, width: int) -> tuple[int, int, int]:
    """Return the distance between the nodes of what passes, and their rows and columns."""
    side = max(NODES, -(-max(height, width) // MOST_NODES))
    return side, (height - 1) // side + 2, (width - 1) // side + 2


def _tuples(settings: dict[str, Any]) -> dict[str, Any]:
    """Restore tuples in settings, which JSON turned into lists."""
    return {k: tuple(v) if isinstance(v, list) else v for k, v in settings.items()}


def _from(header: dict[str, Any], arrays: checkpoints.Stored) -> Model:
    """Make a model; an array is read only after its shape agrees with the settings."""
    check_choice(header["field"], tuple(FIELDS), "field")
    settings = FIELDS[header["field"]](**_tuples(header["settings"]))
    b = header["bounds"]
    x, y, z = map(float, b["center"])
    bounds = Bounds((x, y, z), float(b["half"]), bool(b["unbounded"]))
    frame = Frame(bounds, *(float(header[name]) for name in ("near", "far", "pixel")))
    if not (0 <= frame.near < frame.far and frame.pixel > 0 and np.isfinite([x, y, z]).all()):
        raise ValueError(f"bounds, near, far and pixel must be in range, got {frame}")
    count = arrays.shape("cameras.poses")[0]
    if count > MOST_VIEWS:
        raise ValueError(f"cameras.poses must be at most {MOST_VIEWS}, got {count}")
    poses, intrinsics, distortion = (
        taken(arrays, f"cameras.{part}", (count, *shape), np.float64)
        for part, shape in (("poses", (3, 4)), ("intrinsics", (4,)), ("distortion", (5,)))
    )
    views = cameras(poses, intrinsics, *header["size"], distortion=distortion)
    check_positive(bounds.half, "half")
    check_code(header["background"], Background, "background")
    training = Training(**header["training"])
    count = arrays.shape("marks")[0]
    if count > MOST_MARKS:
        raise ValueError(f"marks must be at most {MOST_MARKS}, got {count}")
    marks = taken(arrays, "marks", (count, len(Mark._fields)), np.float64)
    training.marks = [Mark(int(m[0]), *map(float, m[1:])) for m in marks]
    behind = taken(arrays, "behind", (3,))
    appearance = header.get("appearance")
    if appearance is not None:
        check_choice(appearance, tuple(APPEARANCES), "appearance")
    if isinstance(settings, (HashField, MLPField, VoxelField)):  # others allocate when restored
        settings.check_state(arrays.part("state"), frame)
    try:
        made = built(settings, frame, int(header["seed"]), appearance)
    except MemoryError as error:
        raise ValueError(f"its settings must fit into memory, got {settings}: {error}") from None
    check_integer(training.step, "step", 0, 2**31 - 1)
    check_integer(training.rays, "rays", 0, made.rays)  # more would exceed the kernels' arrays
    made.restore(arrays.part("state"))
    given = arrays.part("extra")
    numbers = 0 if appearance is None else APPEARANCES[appearance]
    extra = {name: _extra(given, name, views, numbers) for name in given}
    if appearance is not None:
        _check_rows(extra, APPEARANCE, "values")
    return Model(made, settings, header["background"], behind.astype(np.float32), views,
                 int(header["seed"]), training, extra, appearance,
                 int(header.get("gauge", 0)),
                 _flag(header, extra, "robust", DISTRACTORS, "share"),
                 _flag(header, extra, "transient", TRANSIENT, "values"))  # fmt: skip


def built(settings: Any, frame: Frame, seed: int, appearance: str | None) -> Field:
    """Return the field of settings, for this kind of light.

    Raises
    ------
    ValueError
        If the field has no perceptron of colours, which an 'embedding' needs.
    """
    if appearance != "embedding":
        return settings.build(runtime(), frame, seed)
    if not isinstance(settings, (HashField, MLPField)):
        raise ValueError(
            "appearance must be 'affine' for a field without a perceptron of colours, got "
            f"'embedding' for a {type(settings).__name__}"
        )
    return settings.build(runtime(), frame, seed, lit=True)


def _extra(given: checkpoints.Stored, name: str, cameras: Cameras, numbers: int) -> np.ndarray:
    """Return a colour, or numbers of each photograph, or the state of their optimizers.

    `numbers` are those of the light of a photograph.
    """
    if name == DISTRACTORS + "noise":
        return taken(given, name, (1,))
    if not name.startswith((APPEARANCE, DISTRACTORS, TRANSIENT)):
        return taken(given, name, (3,))
    count, views = given.shape(name)[0], len(cameras)
    if count > views:
        raise ValueError(f"{name} must have at most {views} rows, got {count}")
    if name.startswith(DISTRACTORS) and not name.endswith("views"):
        shape = (count, *patches_of(cameras.height, cameras.width)[1:])
        dtype = np.float32 if name == DISTRACTORS + "share" else np.int32
        return taken(given, name, shape, dtype)
    if name.startswith(TRANSIENT) and not name.endswith("views"):
        return taken(given, name, (count, *nodes_of(cameras.height, cameras.width)[1:], 5))
    if not name.endswith("views"):
        return taken(given, name, (count, numbers))
    found = taken(given, name, (count,), np.int32)
    if count and not 0 <= found.min() <= found.max() < views:
        raise ValueError(f"{name} must be numbers of cameras, got {found.min()} to {found.max()}")
    return found


def _flag(
    header: dict[str, Any], extra: dict[str, np.ndarray], option: str, prefix: str, name: str
) -> bool:
    """Return whether an option was set, if its arrays are there."""
    found = header.get(option) is True
    if found:
        _check_rows(extra, prefix, name)
    return found


def _check_rows(extra: dict[str, np.ndarray], prefix: str, name: str) -> None:
    """Refuse arrays of photographs that do not belong together."""
    rows = {extra.get(prefix + part, np.zeros(0)).shape[0] for part in ("views", name)}
    if len(rows) != 1 or 0 in rows:
        raise ValueError(f"{prefix}{name} must have one row for each photograph, got {rows}")
