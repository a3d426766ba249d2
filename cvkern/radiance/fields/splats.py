"""A field of Gaussian splats."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._checks import check_integer, check_number, check_positive
from cvkern._files import as_path
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import AdamRule, CameraSet, Composited, Rays, Seen
from cvkern.kernels.codes.splats import SHOWN, SLOPES, TILE, Lists, Screen, Sight, Splats, Tiles
from cvkern.radiance.fields.field import Field, Frame, Learning, View
from cvkern.radiance.fields.parameters import Clip, Parameters
from cvkern.radiance.march import STOP, taken
from cvkern.radiance.scenes.photographs import Scene
from cvkern.radiance.splats.relocation import relocated
from cvkern.radiance.splats.starts import RANDOM, at_points_of, at_random, of_file, of_training

BETAS, EPSILON = (0.9, 0.999), 1e-15
# Learning rates, except that of the means.
RATES = {"turns": 2e-3, "scales": 1e-2, "opacities": 5e-2, "colors": 5e-3, "sides": 5e-4}
WANDER = 1e6  # factor of the variance of a splat, times the rate of the means: its random moves
PERIOD, FIRST = 100, 100  # steps between relocations, and the step of the first one
LAST = 0.85  # share of the training after which nothing is relocated
NEAREST = 0.04  # depth below which splats are not seen, at most
MOST_PIXELS, MOST_ENTRIES = 2**26, 2**30

Room = Callable[[str, tuple[int, ...], Any], Any]  # makes an array of a name, shape and dtype
Ranked = tuple[Any, Any, Any]  # the order, ranks and ends of `Lists`


@dataclass(frozen=True)
class SplatField:
    """Settings of a field of Gaussian splats.

    A splat is a small ellipsoid that fades like a bell from its middle. Splats are sorted by depth
    and drawn one over the other, as in 3DGS [1]_, so pictures take little time. Each batch of the
    training is a whole photograph. The number of splats is fixed: those that fade become copies of
    others, and those that are hardly seen wander, as in 3DGS-MCMC [2]_.

    Raises
    ------
    TypeError
        If a number has the wrong type.
    ValueError
        If a number is out of its range.

    Notes
    -----
    The same steps give the same model, bit for bit, on the CPU with any number of threads, and on a
    GPU: no sum depends on an order.

    Pictures are made of whole views, and an opacity on a screen is no density, so :func:`mesh`
    refuses a field of splats; :func:`point_cloud` takes it. For it, :func:`fit` refuses `spread`,
    and masks together with `robust` or `transient`. Depths are those of the middles of the splats,
    and a lens bends a splat as it bends its middle.

    References
    ----------
    .. [1] B. Kerbl, G. Kopanas, T. Leimkühler and G. Drettakis, "3D Gaussian splatting for
       real-time radiance field rendering", ACM Transactions on Graphics 42(4), 2023.
    .. [2] S. Kheradmand, D. Rebain, G. Sharma, W. Sun, Y.-C. Tseng, H. Isack, A. Kar, A.
       Tagliasacchi and K. M. Yi, "3D Gaussian splatting as Markov chain Monte Carlo", NeurIPS 2024.
    """

    splats: int = 2**16
    """Number of splats."""
    start: str | os.PathLike[str] | None = None
    """What to begin with: by default, points of a small :class:`VoxelField`, which is trained first
    for 200 steps, beyond the time of :func:`fit`. ``"random"`` for random places. Or a path to
    points in units of the world: a ``.ply`` file of points, with or without colours, or of splats;
    the folder of a reconstruction, COLMAP's or one of :func:`cvkern.write_reconstruction`; or a
    model of any field, ``.npz``, whose :func:`point_cloud` is taken."""
    degree: int = 3
    """Degree of the harmonics of the colours, 0 to 3; 0 for colours that are the same from all
    sides."""
    blur: float = 1 / 12
    """Variance that a pixel adds to a splat on the screen, in units of the square of a pixel's
    side: by default that of the pixel itself. Programs of 3DGS add 0.3, which is softer."""
    learning_rate: float = 1.6e-4
    """Learning rate of the places, as a share of the reach of the cameras."""
    final_rate: float = 0.01
    """The same at the end, as a share of that at the beginning."""
    fade: float = 3e-4
    """Cost of the mean opacity, in units of the mean squared error of a photograph."""
    shrink: float = 3e-4
    """Cost of the mean size."""

    def __post_init__(self) -> None:
        check_integer(self.splats, "splats", 1, 2**24)
        check_integer(self.degree, "degree", 0, 3)
        for name in ("blur", "learning_rate", "final_rate"):
            check_positive(getattr(self, name), name)
        for name in ("fade", "shrink"):
            check_number(getattr(self, name), name, low=0.0)
        if self.start is not None:
            object.__setattr__(self, "start", str(as_path(self.start, "start")))

    def build(self, rt: Runtime, frame: Frame, seed: int) -> SplatCloud:
        """Return the field itself, without splats yet."""
        return SplatCloud(rt, frame, self, seed)


class SplatCloud(Field):
    """A field with the settings of a :class:`SplatField`."""

    whole = True
    rays = first_rays = MOST_PIXELS
    learnt: dict[str, Parameters]
    views: CameraSet
    screen: Screen
    ranked: Ranked
    lists: Lists

    def __init__(self, rt: Runtime, frame: Frame, settings: SplatField, seed: int):
        self.rt, self.frame, self.settings, self.seed = rt, frame, settings, seed
        self.near = min(frame.near or NEAREST, NEAREST)
        self._clip, self._room = Clip(rt, None), 0
        self._rates = {name: rt.zeros((3,)) for name in Splats._fields}

    def _shapes(self) -> dict[str, tuple[int, int]]:
        count, more = self.settings.splats, 3 * ((self.settings.degree + 1) ** 2 - 1)
        widths = dict(zip(Splats._fields, (3, 4, 3, 1, 3), strict=False))
        return {name: (count, n) for name, n in widths.items()} | {
            "sides": (count, more) if more else (1, 1)
        }

    def start(self, scene: Scene, options: Mapping[str, Any]) -> None:
        """See :meth:`Field.start`."""
        s, given = self.settings, (self.settings.splats, self.settings.degree, self.seed)
        cloud = None
        if s.start is None:
            cloud = of_training(scene, options, s.splats, self.seed)
        elif s.start != RANDOM:
            cloud = of_file(os.fspath(s.start))
        if cloud is None or not len(cloud[0]):
            self.become(at_random(self.frame, *given))
        else:
            self.become(at_points_of(cloud, self.frame, *given))

    def become(self, splats: Splats) -> None:
        """Begin with these splats."""
        self.edition += 1
        self.learnt = {
            name: Parameters(self.rt, values, np.dtype(np.float32))
            for name, values in splats._asdict().items()
        }

    @property
    def splats(self) -> Splats:
        """The splats, as kernels take them."""
        return Splats(*(self.learnt[name].values for name in Splats._fields))

    def begin(self, views: CameraSet) -> None:
        """See :meth:`Field.begin`."""
        rt = self.rt
        self.views, count = views, views.width * views.height
        self.rays = self.first_rays = count
        self.rendered = Composited(
            rt.zeros((count, 3)), rt.zeros((count,)), rt.zeros((count,)), rt.zeros((1,))
        )
        self.view = rt.zeros((1,), np.int32)
        eyes = rt.to_numpy(views.poses)[:, :, 3].astype(np.float64)
        reach = np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max()
        self.reach = 1.1 * float(reach) or 1.0
        self.leap = _leap(len(eyes))
        tiles = _tiles(views.width, views.height)[1]
        self.screen, self.ranked = self._screen(lambda _, shape, dtype: rt.zeros(shape, dtype))
        self.ranges, self._room = rt.zeros((tiles + 1,), np.int32), 0
        most = 0
        for view in range(0, len(eyes), max(1, len(eyes) // 8)):
            rt.write(self.view, np.array([view], np.int32))
            self._sort(self._sight(views, self.view), self.screen, self.ranked)
            most = max(most, self.taken())
        self._make_room(most)

    def _make_room(self, entries: int) -> None:
        """Have room for about twice as many entries."""
        rt = self.rt
        room = self._room = min(max(2 * entries, 2**12), MOST_ENTRIES)
        self.edition += 1
        entries, sources = (rt.zeros((room,), np.int32) for _ in range(2))
        self.lists = Lists(*self.ranked, entries, sources, self.ranges)
        self.slopes = rt.zeros((room, SLOPES))
        self._most = 0

    def photograph(self, images: Any, seed: int, step: Any, targets: Any, places: Any) -> None:
        """See :meth:`Field.photograph`."""
        self.rt.radiance.fields.splats.batches.photograph(
            images, self.leap, seed, step, self.view, targets, *places
        )

    def leave_out(self, masks: Any, errors: Any, gradients: tuple[Any, Any, Any]) -> None:
        """See :meth:`Field.leave_out`."""
        self.rt.radiance.fields.splats.batches.leave_out(masks, self.view, errors, *gradients)

    def _sight(self, views: CameraSet, view: Any) -> Sight:
        v = views
        return Sight(v.poses, v.lenses, view, v.width, v.height, self.near, self.settings.blur)

    def _screen(self, room: Room) -> tuple[Screen, Ranked]:
        """Return room for all splats on a screen, and for their order."""
        count = self.settings.splats
        screen = Screen(
            room("shown", (count, SHOWN), np.float32), room("boxes", (count, 4), np.int32),
            room("keys", (count,), np.int32),
        )  # fmt: skip
        order, ranks, ends = (room(n, (count,), np.int32) for n in ("order", "ranks", "ends"))
        return screen, (order, ranks, ends)

    def _sort(self, sight: Sight, screen: Screen, ranked: Ranked) -> None:
        kernels = self.rt.radiance.fields.splats
        kernels.projection.project(self.splats, sight, screen)
        kernels.lists.sort(screen, *ranked)

    def _picture(self, sight: Sight, screen: Screen, lists: Lists) -> Tiles:
        """Return a picture in tiles, whose lists may still be filled."""
        return Tiles(screen.shown, *lists[3:], sight.width, sight.height, STOP)

    def _composite(self, sight: Sight, screen: Screen, lists: Lists, seen: Seen) -> None:
        kernels = self.rt.radiance.fields.splats
        kernels.lists.fill(screen, _tiles(sight.width, sight.height)[0], lists)
        kernels.tiles.composite(self._picture(sight, screen, lists), seen)

    def forward(self, rays: Rays, step: Any) -> Composited:
        """See :meth:`Field.forward`: render the photograph that was chosen."""
        sight = self._sight(self.views, self.view)
        self._sort(sight, self.screen, self.ranked)
        self._composite(sight, self.screen, self.lists, Seen(*self.rendered[:3]))
        return self.rendered

    def backward(self, gradients: Composited) -> None:
        """See :meth:`Field.backward`."""
        kernels = self.rt.radiance.fields.splats
        sight = self._sight(self.views, self.view)
        kernels.tiles.composite_backward(
            Seen(*gradients[:3]), self._picture(sight, self.screen, self.lists),
            Seen(*self.rendered[:3]), self.slopes,
        )  # fmt: skip
        to = Splats(*(self.learnt[name].gradients for name in Splats._fields))
        kernels.projection.project_backward(self.splats, sight, self.lists, self.slopes, to)
        s = self.settings
        each = self.rays / s.splats
        kernels.learning.restrain(self.splats, s.fade * each, s.shrink * each / 3, to)

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        return [p.gradients for p in self.learnt.values()]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        s, rt = self.settings, self.rt
        adam, rule = rt.radiance.training.adam, AdamRule(*BETAS, EPSILON)
        self._clip.update(learning.scale / self.gradient_scale)
        for name, p in self.learnt.items():
            rate, final = RATES.get(name, 0.0), 1.0
            if name == "means":
                rate, final = s.learning_rate * self.reach, s.final_rate
            adam.learning_rate(
                learning.step, learning.progress, rate, 1, final, *BETAS, self._rates[name]
            )
            adam.adam(self._rates[name], self._clip.factor, rule, *p.flat())
        rt.radiance.fields.splats.learning.wander(
            self._rates["means"], WANDER, self.seed, learning.step, self.splats
        )

    def tend(self, step: int, learning: Learning) -> None:
        """See :meth:`Field.tend`: relocate splats that have faded."""
        if step < FIRST or step % PERIOD:
            return
        rt = self.rt
        if float(rt.to_numpy(learning.progress)[0]) > LAST:
            return
        if self._room > max(4 * self._most, 2**12):
            self._make_room(self._most)
        self._most = 0
        logits = rt.to_numpy(self.learnt["opacities"].values)[:, 0].astype(np.float64)
        rows, numbers, count = relocated(1 / (1 + np.exp(-logits)), self.seed, step)
        of = [Splats(*(getattr(self.learnt[n], part) for n in Splats._fields))
              for part in ("values", "mean", "square")]  # fmt: skip
        for part in (slice(count), slice(count, None)):
            if len(rows[part]):
                rt.radiance.fields.splats.learning.relocate(
                    rt.send("splats.rows", np.ascontiguousarray(rows[part])),
                    rt.send("splats.numbers", np.ascontiguousarray(numbers[part])),
                    *of,
                )

    def taken(self) -> int:
        """See :meth:`Field.taken`; samples are tiles of splats. Make room for more if necessary."""
        found = int(self.rt.to_numpy(self.ranked[-1])[-1])
        if self._room:
            self._most = max(self._most, found)
            if found > 0.8 * self._room:
                self._make_room(found)
        return found

    def rays_for(self, samples: int, rays: int) -> int:
        """See :meth:`Field.rays_for`: all pixels of a photograph."""
        return self.rays

    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """Refuse, because splats are drawn on whole views."""
        raise ValueError("model must render single rays, which a field of splats cannot")

    def draw(self, cameras: CameraSet, seen: View) -> None:
        """See :meth:`Field.draw`."""
        rt, number = self.rt, self.settings.splats

        def room(name: str, shape: tuple[int, ...], dtype: Any = np.int32) -> Any:
            return rt.scratch(f"splats.{name}", shape, dtype)

        sight = self._sight(cameras, rt.constant(np.zeros(1, np.int32)))
        screen, ranked = self._screen(room)
        self._sort(sight, screen, ranked)
        entries, tiles = int(rt.to_numpy(ranked[-1])[-1]), _tiles(sight.width, sight.height)[1]
        # Sums of 32 bits may have gone beyond their range before the last splat.
        if number * tiles >= 2**31:
            boxes = rt.to_numpy(screen.boxes)[:, 2:].astype(np.int64)
            entries = int(boxes.prod(axis=1).sum())
        if not 0 <= entries <= MOST_ENTRIES:
            raise ValueError(
                f"cameras must meet at most 2^30 tiles of splats in a view, got {entries}"
            )
        entries = max(1, entries)
        lists = Lists(
            *ranked, room("entries", (entries,)), room("sources", (entries,)),
            room("ranges", (tiles + 1,)),
        )  # fmt: skip
        self._composite(sight, screen, lists, Seen(*seen))

    def densities(self, points: np.ndarray) -> np.ndarray:
        """Refuse, because an opacity on a screen is no density."""
        raise ValueError(
            "model must have densities, which splats have not: point_cloud makes points of them"
        )

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        found: dict[str, np.ndarray] = {}
        for name, p in self.learnt.items():
            found |= p.state(f"{name}.", self.rt)
        return found

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """See :meth:`Field.to_render`; places stay in full precision."""
        found = super().to_render(state)
        return found | {"means.values": state["means.values"]}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        shapes = self._shapes()
        values = {name: taken(state, f"{name}.values", shape) for name, shape in shapes.items()}
        self.become(Splats(**values))
        for name, p in self.learnt.items():
            p.restore(f"{name}.", state, self.rt)


def _leap(count: int) -> int:
    """Return how many photographs to go on by, so that each has its turn."""
    near = max(1, round(0.618 * count))
    return next(n for n in range(near, near + count + 1) if math.gcd(n, count) == 1)


def _tiles(width: int, height: int) -> tuple[int, int]:
    """Return the number of tiles in a row of the screen, and of all."""
    columns = -(-width // TILE)
    return columns, columns * -(-height // TILE)
