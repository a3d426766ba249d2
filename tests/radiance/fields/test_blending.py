"""Pictures of several reference cameras, blended, and their gradients, against NumPy in float64."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import Rays, Seen
from cvkern.radiance.rendering import owned
from tests.radiance.fields.reference_blending import blend

RAYS, ACTIVE, CAMERAS = 12, 10, 3
# The exponents are up to 4 x 130, with roundings of 2^-24 of that, for numbers up to 3.
CLOSE = 2e-4


class Case:
    """Random rays; one that no camera sees, one that a single camera sees, and one far away."""

    def __init__(self, cameras=CAMERAS):
        rng = np.random.default_rng(0)
        self.origins = rng.normal(size=(RAYS, 3))
        self.eyes = np.column_stack((rng.normal(size=(cameras, 3)), rng.uniform(1, 4, cameras)))
        self.opacity = rng.uniform(0.1, 1, (cameras, RAYS))
        self.opacity[:, 1] = 0
        self.opacity[1:, 2] = 0
        self.origins[3] = 0, 0, 130  # all weights are below the least float32, as e^-130 is
        self.colors = self.opacity[..., None] * rng.uniform(0, 1, (cameras, RAYS, 3))
        self.depths = self.opacity * rng.uniform(1, 3, (cameras, RAYS))
        self.given = rng.normal(size=(RAYS, 3)), *rng.normal(size=(2, RAYS))
        for name in ("origins", "eyes", "opacity", "colors", "depths"):
            setattr(self, name, getattr(self, name).astype(np.float32).astype(np.float64))

    def arrays(self, rt):
        """Return the arguments of the kernels but the gradients and the results."""
        origins, eyes = (owned(rt, a.astype(np.float32)) for a in (self.origins, self.eyes))
        active = owned(rt, np.array([ACTIVE], np.int32))
        parts = (self.colors.reshape(-1, 3), self.opacity.ravel(), self.depths.ravel())
        parts = Seen(*(owned(rt, a.astype(np.float32)) for a in parts))
        return Rays(origins, rt.zeros((RAYS, 3)), active), eyes, parts

    def seen(self, rt):
        seen = Seen(rt.zeros((RAYS, 3)), rt.zeros((RAYS,)), rt.zeros((RAYS,)))
        rt.radiance.fields.planes.blending.blend(*self.arrays(rt), seen)
        return seen

    def truth(self):
        return blend(self.origins, self.eyes, self.colors, self.opacity, self.depths)

    def slopes(self, rt):
        """Return the gradients by colours, opacities and depths, camera by camera."""
        rays, eyes, parts = self.arrays(rt)
        count = len(self.eyes) * RAYS
        d_parts = Seen(rt.zeros((count, 3)), rt.zeros((count,)), rt.zeros((count,)))
        d_seen = Seen(*(owned(rt, g.astype(np.float32)) for g in self.given))
        seen = self.seen(rt)
        rt.radiance.fields.planes.blending.blend_backward(d_seen, rays, eyes, parts, seen, d_parts)
        shapes = self.colors.shape, self.opacity.shape, self.depths.shape
        return [rt.to_numpy(a).reshape(s) for a, s in zip(d_parts, shapes, strict=True)]

    def loss(self):
        found = self.truth()
        return sum((g * f)[:ACTIVE].sum() for g, f in zip(self.given, found, strict=True))


@pytest.mark.usefixtures("backend")
def test_blending_is_the_closed_form():
    rt, case = runtime(), Case()
    truth = case.truth()
    assert not truth[1][1]
    np.testing.assert_allclose(truth[0][2], case.colors[0, 2], rtol=1e-12)
    for found, wanted in zip(case.seen(rt), truth, strict=True):
        np.testing.assert_allclose(rt.to_numpy(found)[:ACTIVE], wanted[:ACTIVE], atol=CLOSE)
        assert not rt.to_numpy(found)[ACTIVE:].any()


@pytest.mark.usefixtures("backend")
def test_one_camera_changes_no_bit():
    rt, case = runtime(), Case(1)
    _, _, parts = case.arrays(rt)
    for found, part in zip(case.seen(rt), parts, strict=True):
        np.testing.assert_array_equal(rt.to_numpy(found)[:ACTIVE], rt.to_numpy(part)[:ACTIVE])


@pytest.mark.usefixtures("backend")
def test_gradients_are_central_differences():
    case, small = Case(), 1e-6
    for name, found in zip(("colors", "opacity", "depths"), case.slopes(runtime()), strict=True):
        values, wanted = getattr(case, name), np.zeros(found.shape)
        for at in np.ndindex(*found.shape):
            if at[1] == 1 or at[1] >= ACTIVE:
                continue  # without any opacity the colours have no limit
            before = values[at]
            values[at] = before + small
            above = case.loss()
            values[at] = before - small
            wanted[at] = (above - case.loss()) / (2 * small)
            values[at] = before
        np.testing.assert_allclose(found, wanted, rtol=CLOSE, atol=10 * CLOSE, err_msg=name)
