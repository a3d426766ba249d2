"""Numbers that travel together through kernels, as Taichi structures.

Arrays stay arguments of their own: a structure that holds some (`ti.types.argpack`) takes 0.7 ms a
launch on CUDA, and keeps memory there.
"""

from typing import Any

import taichi as ti

from cvkern.kernels.codes import radiance as codes

March = ti.types.struct(
    levels=ti.i32,
    cells=ti.i32,
    unbounded=ti.i32,
    near=ti.f32,
    far=ti.f32,
    finest=ti.f32,
    cone=ti.f32,
    most=ti.i32,
    jittered=ti.i32,
    seed=ti.i32,
)
"""Which cells of space are looked at, and where on its way a ray has samples."""

Comparison = ti.types.struct(kind=ti.i32, huber=ti.f32, scale=ti.f32, seed=ti.i32)
"""How colours are held against photographs."""

Round = ti.types.struct(few=ti.i32, living=ti.i32)
"""A round of a view: the samples of a ray at most, and the rays that go on."""

Grid = ti.types.struct(basis=ti.i32, least=ti.f32, stop=ti.f32)
"""How a grid is read: coefficients of a channel, the raw density below which there is nothing,
and the share of light behind which there is no need to look."""


def march_of(space: codes.Space, march: codes.March) -> Any:
    """Return the numbers of both."""
    numbers = march._asdict()
    del numbers["step"]
    return March(levels=space.levels, cells=space.cells, unbounded=int(space.unbounded), **numbers)
