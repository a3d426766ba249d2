"""Numbers that travel together through kernels, as Taichi structures.

Arrays stay separate arguments, because a structure with arrays (`ti.types.argpack`) takes 0.7 ms
per launch on CUDA, and keeps memory there.
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
"""The occupied cells of space, and the positions of samples along a ray."""

Comparison = ti.types.struct(kind=ti.i32, huber=ti.f32, scale=ti.f32, seed=ti.i32, censored=ti.i32)
"""The options of the loss between colours and photographs."""

Round = ti.types.struct(few=ti.i32, living=ti.i32)
"""A round of a view: the largest number of samples of a ray, and the number of active rays."""

Grid = ti.types.struct(basis=ti.i32, least=ti.f32, stop=ti.f32)
"""The parameters of reading a grid: coefficients of a channel, the raw density below which space
is empty, and the share of light at which a ray ends."""


def march_of(space: codes.Space, march: codes.March) -> Any:
    """Return the numbers of both as a structure."""
    numbers = march._asdict()
    del numbers["step"]
    return March(levels=space.levels, cells=space.cells, unbounded=int(space.unbounded), **numbers)


def comparison_of(c: codes.Comparison) -> Any:
    """Return the numbers of a comparison as a structure."""
    return Comparison(
        kind=c.kind, huber=c.huber, scale=c.scale, seed=c.seed, censored=int(c.censored)
    )
