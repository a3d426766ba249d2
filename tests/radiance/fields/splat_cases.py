"""Splats before a camera, and their way through the kernels."""

from typing import Any

import numpy as np

from cvkern.kernels.codes.radiance import Seen
from cvkern.kernels.codes.splats import SHOWN, SLOPES, TILE, Lists, Screen, Sight, Splats, Tiles
from cvkern.radiance import look_at
from cvkern.radiance.rendering import owned
from tests.radiance.fields import reference_splats as reference

EYE = np.array([0.3, -2.5, 0.4])
STRAIGHT = [40, 42, 20, 17, 0, 0, 0, 0, 0]
BENT = [40, 42, 20, 17, 0.05, -0.02, 0.001, -0.002, 0.01]


class Case:
    """Random splats in a cube, seen from the side; and gradients by the picture."""

    def __init__(self, count=60, width=41, height=35, lens: Any = BENT, degree=3, seed=0):
        rng = np.random.default_rng(seed)
        more = 3 * ((degree + 1) ** 2 - 1)
        self.splats = [
            rng.uniform(-1, 1, (count, 3)), rng.normal(size=(count, 4)),
            rng.uniform(-3.5, -1.5, (count, 3)), rng.normal(0, 2, (count, 1)),
            rng.normal(0, 0.4, (count, 3)),
            rng.normal(0, 0.4, (count, more) if more else (1, 1)),
        ]  # fmt: skip
        pose = look_at(EYE, np.zeros(3))[0]
        # The kernels get numbers in float32, so the reference starts from these.
        self.splats = [a.astype(np.float32).astype(np.float64) for a in self.splats]
        self.pose, self.lens = (
            np.array(a, np.float32).astype(np.float64) for a in (pose, lens)
        )  # fmt: skip
        self.width, self.height = width, height
        area = width * height
        self.gradients = [rng.normal(size=(area, 3)), rng.normal(size=area), np.zeros(area)]

    def truth(self, splats=None, stop=reference.STOP, slopes=None):
        splats = self.splats if splats is None else splats
        if splats[5].shape[0] != len(splats[0]):
            splats = [*splats[:5], np.zeros((len(splats[0]), 0))]
        return reference.render(splats, self.pose, self.lens, self.width, self.height, stop, slopes)

    def loss(self, splats, stop=reference.STOP, slopes=None):
        seen = self.truth(splats, stop, slopes)
        return sum((g * a).sum() for g, a in zip(self.gradients[:2], seen[:2], strict=True))

    def bends(self):
        """Return the slopes of the lens for each splat, which gradients take as constant."""
        arms = (self.splats[0] - self.pose[:, 3]) @ self.pose[:, :3]
        return [reference.bend_slopes(a[:2] / a[2], self.lens) for a in arms]


class Run:
    """A case in the kernels."""

    def __init__(self, rt, case, room=None):
        self.rt, self.case = rt, case
        self.kernels = rt.radiance.fields.splats
        count, w, h = len(case.splats[0]), case.width, case.height
        self.splats = Splats(*map(self.own, case.splats))
        view = rt.zeros((1,), np.int32)
        poses, lenses = self.own(case.pose[None]), self.own(case.lens[None])
        self.sight = Sight(poses, lenses, view, w, h, reference.NEAR, reference.BLUR)
        self.screen = Screen(
            rt.zeros((count, SHOWN)), rt.zeros((count, 4), np.int32), rt.zeros((count,), np.int32)
        )
        order, ranks, ends = (rt.zeros((count,), np.int32) for _ in range(3))
        self.kernels.projection.project(self.splats, self.sight, self.screen)
        self.kernels.lists.sort(self.screen, order, ranks, ends)
        room = max(1, int(rt.to_numpy(ends)[-1])) if room is None else room
        across = -(-w // TILE)
        tiles = across * -(-h // TILE)
        self.lists = Lists(
            order, ranks, ends, rt.zeros((room,), np.int32), rt.zeros((room,), np.int32),
            rt.zeros((tiles + 1,), np.int32),
        )  # fmt: skip
        self.kernels.lists.fill(self.screen, across, self.lists)

    def own(self, values, dtype: Any = np.float32):
        return owned(self.rt, np.asarray(values, dtype))

    def read(self, arrays):
        return [self.rt.to_numpy(a).copy() for a in arrays]

    def forward(self, stop=reference.STOP):
        case, rt = self.case, self.rt
        area = case.width * case.height
        self.tiles = Tiles(self.screen.shown, *self.lists[3:], case.width, case.height, stop)
        self.seen = Seen(rt.zeros((area, 3)), rt.zeros((area,)), rt.zeros((area,)))
        self.kernels.tiles.composite(self.tiles, self.seen)
        return self.read(self.seen)

    def backward(self):
        """Return the gradients of the splats, after :meth:`forward`."""
        case, rt = self.case, self.rt
        given = Seen(*map(self.own, case.gradients))
        slopes = rt.zeros((self.lists.entries.shape[0], SLOPES))
        found = Splats(*(rt.zeros(a.shape) for a in case.splats))
        self.kernels.tiles.composite_backward(given, self.tiles, self.seen, slopes)
        self.kernels.projection.project_backward(self.splats, self.sight, self.lists, slopes, found)
        return self.read(found)
