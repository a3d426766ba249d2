"""Steps over the whole grid of density and colour on the CPU: one thread a slab of planes.

Only nodes that rays have touched count: `touched` is read eight nodes at a time.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from cvkern.kernels.warp.radiance.training._adam_step import STEP_ON_CPU

wp.set_module_options({"enable_backward": False})

# BODY for each touched node of a plane.
_TOUCHED = """
    #pragma clang fp contract(fast)
    const int side = density.shape[0];
    const size_t plane = (size_t)side * side, begin = plane * k, end = begin + plane;
    for (size_t base = begin; base < end; base += 8) {
        unsigned long long any = 0;
        if (base + 8 <= end) {
            __builtin_memcpy(&any, touched.data + base, 8);
            if (any == 0) continue;
        }
        const size_t stop = base + 8 <= end ? base + 8 : end;
        for (size_t node = base; node < stop; ++node) {
            if (!touched.data[node]) continue;
            BODY
        }
    }
"""

_ADAM = f"""{STEP_ON_CPU}
            touched.data[node] = 0;
            step(
                d_density.data[node] * factor, density_mean.data[node], density_square.data[node],
                density.data[node], rate_density);
            d_density.data[node] = 0.0f;
            float* gs = d_color.data + node * WIDTH;
            float* ms = color_mean.data + node * WIDTH;
            float* vs = color_square.data + node * WIDTH;
            float* ws = color.data + node * WIDTH;
            #pragma clang loop vectorize(assume_safety)
            for (int c = 0; c < WIDTH; ++c) {{
                float m = ms[c], v = vs[c], w = ws[c];
                step(gs[c] * factor, m, v, w, rate_color);
                gs[c] = 0.0f;
                ms[c] = m;
                vs[c] = v;
                ws[c] = w;
            }}
"""

_VARIATION = """
            const int j = (int)((node - begin) / side), i = (int)((node - begin) % side);
            // A neighbour that is not there counts as equal.
            const long long to[6] = {
                i > 0 ? -1 : 0, i + 1 < side ? 1 : 0, j > 0 ? -side : 0, j + 1 < side ? side : 0,
                k > 0 ? -(long long)plane : 0, k + 1 < side ? (long long)plane : 0};
            {
                const float* at = density.data + node;
                float sum = 6.0f * at[0];
                for (int n = 0; n < 6; ++n) sum -= at[to[n]];
                d_density.data[node] += weight_density * sum;
            }
            const float* at = color.data + node * WIDTH;
            const float *a = at + to[0] * WIDTH, *b = at + to[1] * WIDTH, *c = at + to[2] * WIDTH;
            const float *d = at + to[3] * WIDTH, *e = at + to[4] * WIDTH, *f = at + to[5] * WIDTH;
            float* out = d_color.data + node * WIDTH;
            #pragma clang loop vectorize(assume_safety)
            for (int x = 0; x < WIDTH; ++x)
                out[x] += weight_color
                    * (6.0f * at[x] - ((a[x] + b[x]) + (c[x] + d[x]) + (e[x] + f[x])));
"""


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

    adam: wp.Kernel
    total_variation: wp.Kernel


@cache
def kernels(width: int) -> Kernels:
    """Return the kernels for rows of `width` colour coefficients."""

    @wp.func_native(_TOUCHED.replace("BODY", _ADAM).replace("WIDTH", str(width)))
    def adam_plane(
        k: int,
        rate_density: float,
        rate_color: float,
        factor: float,
        beta1: float,
        beta2: float,
        mend: float,
        epsilon: float,
        touched: wp.array3d[wp.uint8],
        d_density: wp.array3d[float],
        density_mean: wp.array3d[float],
        density_square: wp.array3d[float],
        density: wp.array3d[float],
        d_color: wp.array4d[float],
        color_mean: wp.array4d[float],
        color_square: wp.array4d[float],
        color: wp.array4d[float],
    ): ...

    @wp.func_native(_TOUCHED.replace("BODY", _VARIATION).replace("WIDTH", str(width)))
    def variation_plane(
        k: int,
        weight_density: float,
        weight_color: float,
        touched: wp.array3d[wp.uint8],
        density: wp.array3d[float],
        color: wp.array4d[float],
        d_density: wp.array3d[float],
        d_color: wp.array4d[float],
    ): ...

    @wp.kernel
    def adam(
        slab: int,
        first: int,
        last: int,
        rate_density: wp.array[float],  # (3,)
        rate_color: wp.array[float],  # (3,)
        factor: wp.array[float],  # (1,)
        beta1: float,
        beta2: float,
        epsilon: float,
        touched: wp.array3d[wp.uint8],
        d_density: wp.array3d[float],
        density_mean: wp.array3d[float],
        density_square: wp.array3d[float],
        density: wp.array3d[float],
        d_color: wp.array4d[float],
        color_mean: wp.array4d[float],
        color_square: wp.array4d[float],
        color: wp.array4d[float],
    ):
        of_density = rate_density[0] / rate_density[1]
        of_color = rate_color[0] / rate_color[1]
        mend = 1.0 / rate_color[2]
        for k in range(first, last):
            adam_plane(
                k, of_density, of_color, factor[0], beta1, beta2, mend, epsilon, touched, d_density,
                density_mean, density_square, density, d_color, color_mean, color_square, color,
            )  # fmt: skip

    @wp.kernel
    def total_variation(
        slab: int,
        first: int,
        last: int,
        weight_density: float,
        weight_color: float,
        touched: wp.array3d[wp.uint8],
        density: wp.array3d[float],
        color: wp.array4d[float],
        # outputs
        d_density: wp.array3d[float],  # added to
        d_color: wp.array4d[float],  # added to
    ):
        for k in range(first, last):
            variation_plane(
                k, weight_density, weight_color, touched, density, color, d_density, d_color
            )

    return Kernels(adam, total_variation)
