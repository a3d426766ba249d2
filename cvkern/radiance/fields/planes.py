"""A stack of parallel planes in front of a reference camera: a multiplane image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cvkern._archives import shape_of
from cvkern._checks import check_integer, check_positive
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import AdamRule, Composited, Learnt, Rays, Seen, Shine
from cvkern.radiance.fields.field import Field, Frame, Learning, View, halved
from cvkern.radiance.fields.parameters import LIFT, Clip, Parameters
from cvkern.radiance.march import STOP, taken
from cvkern.radiance.scenes.photographs import Scene

BETAS, EPSILON = (0.9, 0.99), 1e-15
WARMUP = 20  # steps until the learning rate reaches its full value
SHINE = 0.05  # learning rate of coefficients of the side, as a share of that of colours
LAST_BYTE = 1 / 255  # share of the light at which a ray through texels of 8 bits ends
LEAST, MOST = 2, 2**13  # rows and columns of a plane
MOST_PLANES, MOST_REFERENCES = 512, 16


@dataclass(frozen=True)
class PlanesField:
    """Settings of a field of parallel planes, a multiplane image.

    The planes are parallel to the image of a reference camera in the middle of the photographs,
    and evenly spaced in 1 / depth. Each has a texture of colours and opacities. Such a field is for
    photographs that look the same way, and for views between them. It begins with a plane sweep of
    the photographs by the stereo costs of this library.

    With a `basis`, a colour depends on the side from which it is seen: on the offset between the
    texel and the one that the reference camera would see in the same direction. To each colour a
    sum of functions of that offset is added, times coefficients that several planes share, as in
    NeX [2]_, with polynomials as the functions.

    With several `references`, cameras are spread among the photographs, and each has planes in
    front of it, for photographs that one camera does not see the whole of. Pictures of their planes
    are blended ray by ray, with weights that fall with the distance from the camera and with what
    its planes let through, as in local light field fusion [3]_. All of them are trained together.

    Raises
    ------
    TypeError
        If a number has the wrong type.
    ValueError
        If a number is out of its range, or `near` is not below `far`.

    Notes
    -----
    On the CPU the same steps give the same model, bit for bit, with any number of threads.

    A texel takes 80 bytes in training. A model saved with ``resumable=False`` has texels of 8 bits
    a channel, which take 4 bytes; its pictures are faster, and differ by the rounding of the
    texels.

    References
    ----------
    .. [1] T. Zhou, R. Tucker, J. Flynn, G. Fyffe and N. Snavely, "Stereo magnification: learning
       view synthesis using multiplane images", ACM Transactions on Graphics 37(4), 2018.
    .. [2] S. Wizadwongsa, P. Phongthawee, J. Yenphraphai and S. Suwajanakorn, "NeX: real-time view
       synthesis with neural basis expansion", CVPR 2021.
    .. [3] B. Mildenhall, P. P. Srinivasan, R. Ortiz-Cayon, N. K. Kalantari, R. Ramamoorthi, R. Ng
       and A. Kar, "Local light field fusion", ACM Transactions on Graphics 38(4), 2019.
    """

    planes: int = 32
    """Number of planes, at most 512."""
    near: float | None = None
    """Depth of the first plane, in units of the world; found from the photographs by default."""
    far: float | None = None
    """Depth of the last plane; found from the photographs by default."""
    detail: float = 1.0
    """Texels per pixel of the photographs, along a side."""
    texels: int = 2**24
    """Largest number of texels of all planes; their detail is reduced to it."""
    basis: int = 0
    """Functions of the side: 0, 2 (linear) or 5 (quadratic). The pages of :func:`write_planes` have
    none."""
    shared: int = 8
    """Planes, one behind the other, that share coefficients of these functions."""
    references: int = 1
    """Reference cameras, at most 16. Each has planes of its own, and their pictures are blended."""
    rays: int = 4096
    """Rays of a batch."""
    learning_rate: float = 0.1
    """Learning rate of the colours and opacities, before the logistic function."""
    final_rate: float = 0.1
    """Learning rate at the end, as a share of that at the beginning."""

    def __post_init__(self) -> None:
        check_integer(self.planes, "planes", 1, MOST_PLANES)
        check_integer(self.references, "references", 1, MOST_REFERENCES)
        check_integer(self.texels, "texels", LEAST**2 * self.planes * self.references, 2**29)
        if check_integer(self.basis, "basis", 0, 5) not in (0, 2, 5):
            raise ValueError(f"basis must be 0, 2 or 5, got {self.basis}")
        check_integer(self.shared, "shared", 1, MOST_PLANES)
        check_integer(self.rays, "rays", 1, 2**20)
        for name in ("detail", "learning_rate", "final_rate"):
            check_positive(getattr(self, name), name)
        for name in ("near", "far"):
            if getattr(self, name) is not None:
                check_positive(getattr(self, name), name)
        if self.near is not None and self.far is not None and self.near >= self.far:
            raise ValueError(f"near must be below far, got {self.near:g} and {self.far:g}")

    def build(self, rt: Runtime, frame: Frame, seed: int) -> Field:
        """Return the field itself, without planes yet."""
        if self.references > 1:
            from cvkern.radiance.fields.blended import BlendedStacks

            return BlendedStacks(rt, frame, self)
        return PlaneStack(rt, frame, self)


class Reference(NamedTuple):
    """The camera whose image the planes are parallel to, and the planes, in the frame's units."""

    pose: np.ndarray
    """Camera to frame, (3, 4) float64."""
    lens: np.ndarray
    """fx, fy, cx, cy of the texels, (4,) float64."""
    disparities: np.ndarray
    """1 / depth of the planes, decreasing, (D,) float64."""


class PlaneStack(Field):
    """A field with the settings of a :class:`PlanesField`."""

    reference: Reference
    texels: Any  # the array that pictures are made from
    parameters: Parameters | None = None  # None if the texels have 8 bits
    shine: Shine | None = None
    coefficients: Parameters | None = None  # what `shine` is made of

    def __init__(self, rt: Runtime, frame: Frame, settings: PlanesField):
        self.rt, self.frame, self.settings = rt, frame, settings
        self.rays = self.first_rays = rays = settings.rays
        self.rendered = Composited(
            rt.zeros((rays, 3)), rt.zeros((rays,)), rt.zeros((rays,)), rt.zeros((rays,))
        )
        self._rate, self._clip = rt.zeros((3,)), Clip(rt, None)
        self._shine_rate, self._exact = rt.zeros((3,)), False

    def start(self, scene: Scene, options: Mapping[str, Any]) -> None:
        """See :meth:`Field.start`: a plane sweep of the photographs."""
        from cvkern.radiance.multiplane.sweep import first_planes

        reference, parameters = first_planes(scene, self.frame, self.settings)
        self._place(reference)
        self._train(parameters)
        if self.settings.basis:
            offsets = self.frame.inside(scene.cameras.poses[~scene.test])[:, :, 3]
            aside = (offsets - reference.pose[:, 3]) @ reference.pose[:, :2]
            farthest = float(np.linalg.norm(aside, axis=1).max())
            reach = reference.lens[:2].max() * farthest * reference.disparities[0]
            self._shine(np.zeros(self._maps(parameters.shape)), max(float(reach), 1.0))

    def _maps(self, texels: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of the coefficients for texels of the shape (D, H, W, ...)."""
        groups = -(-texels[0] // self.settings.shared)
        return groups, *((n - 1) // 2 + 2 for n in texels[1:3]), 3 * self.settings.basis

    def _shine(self, values: np.ndarray, reach: float) -> None:
        """Begin with these coefficients."""
        self.edition += 1
        self.coefficients = Parameters(self.rt, values, np.dtype(np.float32))
        if self._exact:
            self.coefficients.make_deterministic(self.rt)
        self.shine = Shine(self.coefficients.values, self.settings.shared, reach)

    def _place(self, reference: Reference) -> None:
        """Remember where the planes are."""
        rt, self.reference = self.rt, reference
        turn, eye = reference.pose[:, :3].T, reference.pose[:, 3]
        inverse = np.column_stack((turn, -turn @ eye))
        planes = np.concatenate((inverse.ravel(), reference.lens, reference.disparities))
        self.planes = rt.zeros(planes.shape)
        rt.write(self.planes, planes.astype(np.float32))

    def _train(self, parameters: np.ndarray) -> None:
        """Begin with these parameters, (D, H, W, 4)."""
        rt = self.rt
        self.edition += 1
        self.parameters = Parameters(rt, parameters, np.dtype(np.float32))
        if self._exact:
            self.parameters.make_deterministic(rt)
        self.texels = rt.zeros(parameters.shape)
        rt.radiance.fields.planes.texels.values(self.parameters.values, self.texels)

    def paint(self, reference: Reference, texels: np.ndarray) -> None:
        """Become planes of premultiplied texels of 8 bits, (D, H, W, 4), for rendering only."""
        self._place(reference)
        self.parameters = None
        words = np.ascontiguousarray(texels).view("<u4")[..., 0].astype(np.uint32, copy=False)
        self.texels = self.rt.zeros(words.shape, np.uint32)
        self.rt.write(self.texels, words)

    def bytes(self) -> np.ndarray:
        """Return the texels in 8 bits, premultiplied, (D, H, W, 4)."""
        if self.parameters is None:
            words = self.rt.to_numpy(self.texels).astype("<u4", copy=False)
            return np.ascontiguousarray(words).view(np.uint8).reshape(*words.shape, 4)
        return np.round(255 * self.rt.to_numpy(self.texels)).astype(np.uint8)

    def make_deterministic(self) -> None:
        """See :meth:`Field.make_deterministic`; on a GPU, atomics add to the planes."""
        if self.rt.device != "cpu":
            self._exact, self.gradient_scale = True, LIFT
            for learnt in (self.parameters, self.coefficients):
                if learnt is not None:
                    learnt.make_deterministic(self.rt)

    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """See :meth:`Field.see`."""
        active = self.rt.constant(np.array([2**31 - 1], np.int32))
        stop = LAST_BYTE if self.parameters is None else STOP
        self.rt.radiance.fields.planes.rays.render(
            Rays(origins, directions, active),
            self.planes,
            self.texels,
            self.shine,
            stop,
            row,
            Seen(*seen),
        )

    def forward(self, rays: Rays, step: Any) -> Composited:
        """See :meth:`Field.forward`; there is no distortion."""
        self._last = rays, self.planes, self.texels, self.shine, STOP
        self.rt.radiance.fields.planes.rays.render(*self._last, 0, Seen(*self.rendered[:3]))
        return self.rendered

    def backward(self, gradients: Composited) -> None:
        """See :meth:`Field.backward`."""
        learnt, shown = self._learnt(), self.coefficients
        self.rt.radiance.fields.planes.rays.render_backward(
            Seen(*gradients[:3]),
            *self._last,
            Seen(*self.rendered[:3]),
            learnt.sums,
            None if shown is None else shown.sums,
        )
        learnt.collect(self.rt)
        if shown is not None:
            shown.collect(self.rt)

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        beside = [] if self.coefficients is None else [self.coefficients.gradients]
        return [self._learnt().gradients, *beside]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        s, p = self.settings, self._learnt()
        adam, rule = self.rt.radiance.training.adam, AdamRule(*BETAS, EPSILON, sparse=True)
        adam.learning_rate(
            learning.step, learning.progress, s.learning_rate, WARMUP, s.final_rate, *BETAS,
            self._rate,
        )  # fmt: skip
        self._clip.update(learning.scale / self.gradient_scale)
        self.rt.radiance.fields.planes.texels.learn(
            self._rate, self._clip.factor, rule,
            Learnt(p.gradients, p.mean, p.square, p.values), self.texels,
        )  # fmt: skip
        if self.coefficients is not None:
            adam.learning_rate(
                learning.step, learning.progress, SHINE * s.learning_rate, WARMUP, s.final_rate,
                *BETAS, self._shine_rate,
            )  # fmt: skip
            adam.adam(self._shine_rate, self._clip.factor, rule, *self.coefficients.flat())

    def _learnt(self) -> Parameters:
        if self.parameters is None:
            raise ValueError("model must be resumable, got planes of 8 bits, for rendering only")
        return self.parameters

    def taken(self) -> int:
        """See :meth:`Field.taken`; every ray meets every plane."""
        active = int(self.rt.to_numpy(self._last[0].active)[0])
        return active * len(self.reference.disparities)

    def rays_for(self, samples: int, rays: int) -> int:
        """See :meth:`Field.rays_for`; samples take no memory here, so the number is fixed."""
        return self.rays

    def densities(self, points: np.ndarray) -> np.ndarray:
        """See :meth:`Field.densities`.

        It is that of the nearest plane, which is as thick as planes are apart there.
        """
        from scipy.ndimage import map_coordinates

        pose, lens, disparities = self.reference
        at = (np.asarray(points, np.float64) - pose[:, 3]) @ pose[:, :3]
        opacity = self.bytes()[..., 3] / 255
        with np.errstate(all="ignore"):  # points may be beside and behind the camera
            q = 1 / at[:, 2]
            column, row = (lens[k] * at[:, k] * q + lens[2 + k] for k in (0, 1))
        plane = np.zeros(len(at))
        if len(disparities) > 1:
            step = disparities[0] - disparities[1]
            plane = np.round((disparities[0] - q) / step)
            thick = step * at[:, 2] ** 2
        else:
            thick = np.ones(len(at))
        inside = (at[:, 2] > 0) & (plane >= 0) & (plane < len(disparities))
        places = np.where(inside, (plane, row, column), -1.0)
        found = map_coordinates(opacity, places, order=1, cval=0.0)
        found = -np.log1p(-np.minimum(found, 1 - 1e-4)) / np.where(inside, thick, 1.0)
        return np.where(inside, found, 0.0).astype(np.float32)

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        placed = {f"reference.{name}": a for name, a in self.reference._asdict().items()}
        if self.shine is not None and self.coefficients is not None:
            placed["shine.reach"] = np.array([self.shine.reach])
            placed |= self.coefficients.state("shine.", self.rt)
        if self.parameters is None:
            return placed | {"bytes": self.bytes()}
        return placed | self.parameters.state("texels.", self.rt)

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """See :meth:`Field.to_render`: texels of 8 bits, so pictures differ by their rounding."""
        kept = {k: a for k, a in state.items() if k.startswith("reference.")}
        if "shine.values" in state:
            kept["shine.reach"], kept["shine.values"] = (
                state["shine.reach"], halved(state["shine.values"]),
            )  # fmt: skip
        return kept | {"bytes": self.bytes()}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        s, name = self.settings, "bytes" if "bytes" in state else "texels.values"
        shape = shape_of(state, name) if name in state else ()
        sides = shape[1:3]
        if (
            len(shape) != 4 or shape[0] != s.planes or shape[3] != 4
            or not all(LEAST <= n <= MOST for n in sides) or np.prod(shape[:3]) > s.texels
        ):  # fmt: skip
            raise ValueError(
                f"{name} must have shape ({s.planes}, H, W, 4) with at most {s.texels} texels, "
                f"got {shape}"
            )
        parts = ("pose", (3, 4)), ("lens", (4,)), ("disparities", (s.planes,))
        placed = [taken(state, f"reference.{part}", of, np.float64) for part, of in parts]
        check_reference(*placed)
        if s.basis:
            reach = float(taken(state, "shine.reach", (1,), np.float64)[0])
            check_positive(reach, "shine.reach")
            self._shine(taken(state, "shine.values", self._maps(shape)), reach)
        if name == "bytes":
            self.paint(Reference(*placed), taken(state, name, shape, np.uint8))
            return
        self._place(Reference(*placed))
        self._train(taken(state, name, shape))
        self._learnt().restore("texels.", state, self.rt)
        if self.coefficients is not None:
            self.coefficients.restore("shine.", state, self.rt)


def check_reference(pose: np.ndarray, lens: np.ndarray, disparities: np.ndarray) -> None:
    """Refuse numbers of a file that cannot be a reference camera and its planes."""
    if not (np.isfinite(pose).all() and np.isfinite(lens).all() and (lens[:2] > 0).all()):
        raise ValueError("reference must be a finite pose and lens with fx, fy > 0, got others")
    if (
        not ((disparities > 0) & np.isfinite(disparities)).all()
        or (np.diff(disparities) >= 0).any()
    ):
        raise ValueError("reference.disparities must be positive and decrease, got others")
