"""Hash encoding on the CPU, in float32: level by level, with many samples in a vector.

hash.py describes the encoding.
"""

import warp as wp

from cvkern.kernels.codes.radiance import HASH_PRIMES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False})

NATIVE = dict(zip(("PRIME_Y", "PRIME_Z"), (f"{prime}u" for prime in HASH_PRIMES), strict=True))
BATCH = 64  # samples whose corners are found together, before gradients are added


@_native.func_native("_hash_cpu.h", **NATIVE)
def look_up(
    first: int,
    last: int,
    positions: wp.array2d[float],
    total: wp.array[int],
    resolutions: wp.array[int],
    offsets: wp.array[int],
    table: wp.array2d[float],
    features: wp.array2d[float],
): ...


@wp.kernel
def encode(
    slab: int,
    first: int,
    last: int,
    positions: wp.array2d[float],  # (M, 3), in [0, 1]
    total: wp.array[int],  # (1,)
    resolutions: wp.array[int],  # (L,)
    offsets: wp.array[int],  # (L + 1,)
    table: wp.array2d[float],  # (entries, 2)
    # outputs
    features: wp.array2d[float],  # (M, 2 L)
):
    """Compute the features of items `first` to `last`, the samples of a level, level by level."""
    look_up(first, last, positions, total, resolutions, offsets, table, features)


@_native.func_native("_hash_cpu.h", BATCH=BATCH, **NATIVE)
def scatter(
    first: int,
    last: int,
    positions: wp.array2d[float],
    total: wp.array[int],
    resolutions: wp.array[int],
    offsets: wp.array[int],
    d_features: wp.array2d[float],
    d_table: wp.array2d[float],
): ...


@wp.kernel
def backward(
    slab: int,
    first: int,
    last: int,
    positions: wp.array2d[float],  # (M, 3), in [0, 1]
    total: wp.array[int],  # (1,)
    resolutions: wp.array[int],  # (L,)
    offsets: wp.array[int],  # (L + 1,)
    d_features: wp.array2d[float],  # (M, 2 L)
    # outputs
    d_table: wp.array2d[float],  # (entries, 2): added to
):
    """Add the gradients of levels `first` to `last`, so no two threads add to one entry."""
    scatter(first, last, positions, total, resolutions, offsets, d_features, d_table)
