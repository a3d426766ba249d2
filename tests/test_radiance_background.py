"""The gradient of a learnt background against NumPy."""

import numpy as np
import pytest

from cvkern._runtime import runtime


@pytest.mark.parametrize(("rays", "active"), [(1, 1), (7, 3), (300, 300), (1000, 257), (50, 0)])
@pytest.mark.parametrize("parts", [1, 16, 64])
def test_gather(backend, rays, active, parts):
    rng = np.random.default_rng(rays)
    given = rng.normal(size=(rays, 3)).astype(np.float32)
    before = rng.normal(size=3).astype(np.float32)
    rt = runtime()
    gradients, scratch = rt.zeros((3,)), rt.zeros((parts, 3))
    rt.write(gradients, before)
    count = np.array([active], np.int32)
    rt.radiance_background.gather(rt.adopt(given), rt.adopt(count, np.int32), scratch, gradients)
    want = before + given[:active].astype(float).sum(axis=0)
    # At most `rays` additions, each off by 2^-24 of a sum below the sum of the sizes.
    bound = 2**-24 * rays * (np.abs(given).sum() + 1)
    assert np.abs(rt.to_numpy(gradients) - want).max() <= bound
