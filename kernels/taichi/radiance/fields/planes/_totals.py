"""What gradients by the results of rays sum up to, in Taichi."""

import taichi as ti

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def total(
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_depth: f32_1,  # (R,)
    active: i32_1,  # (1,)
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depths: f32_1,  # (R,)
    # outputs
    totals: f32_1,  # (R,)
):
    """Compute <g_C, C> + g_O O + g_D D of each ray."""
    for ray in range(ti.min(active[0], totals.shape[0])):
        total = d_opacity[ray] * opacity[ray] + d_depth[ray] * depths[ray]
        for k in ti.static(range(3)):
            total += d_color[ray, k] * colors[ray, k]
        totals[ray] = total
