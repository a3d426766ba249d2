"""Parts shared by GPU tests: the same call on GPU and CPU, and arrays of every library."""

import warnings

import numpy as np
import pytest

import cvkern
from tests.calls import fields

LIBRARIES = ["torch", "cupy", "jax", "warp"]


def noise(shape=(270, 481), seed=0):
    return np.random.default_rng(seed).random(shape, np.float32)


def reference(call, image):
    """Compute on the CPU with Warp: the bits that every device must give."""
    with cvkern.use(backend="warp", device="cpu"):
        return call(image)


def on_gpu(call, image, backend):
    with cvkern.use(backend=backend, device="cuda"):
        return call(image)


def assert_equal_bits(got, expected):
    """Compare in every bit; the bits of a NaN are the device's own."""
    for a, b in zip(fields(got), fields(expected), strict=True):
        assert a.dtype == b.dtype
        if a.dtype.kind == "f":
            a, b = (np.where(np.isnan(x), x.dtype.type(np.nan), x) for x in (a, b))
        np.testing.assert_array_equal(a.view(np.uint8), b.view(np.uint8))


def give(library, image):
    """Put `image` on the GPU as an array of `library`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX takes a warning on its way to the GPU for a failure
        xp = pytest.importorskip(library)
        if library == "jax":
            try:
                place = xp.devices("gpu")[0]
            except RuntimeError as absent:
                pytest.skip(str(absent))
            return xp.device_put(image, place)
    if library == "torch":
        return xp.from_numpy(image.copy()).cuda()
    if library == "cupy":
        return xp.asarray(image)
    return xp.array(image, device="cuda")


def take(array):
    """Bring an array of any library to the host."""
    if hasattr(array, "get"):  # CuPy
        return array.get()
    if hasattr(array, "cpu"):  # torch
        return array.cpu().numpy()
    return array.numpy() if hasattr(array, "numpy") else np.asarray(array)


def device_of(array):
    kind, index = array.__dlpack_device__()
    return int(kind), int(index)
