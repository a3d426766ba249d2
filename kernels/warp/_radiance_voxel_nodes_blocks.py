"""Steps over the whole grid of density and colour on CUDA: one thread a coefficient of a node.

Only nodes that rays have touched count.
"""

import warp as wp

from ._adam import STEP_ON_CUDA

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def total_variation(
    weight_density: float,
    weight_color: float,
    touched: wp.array[wp.uint8],  # (N^3,)
    density: wp.array[float],  # (N^3,)
    color: wp.array[float],  # (N^3 C,)
    side: int,
    width: int,
    # outputs
    d_density: wp.array[float],  # added to
    d_color: wp.array[float],  # added to
):
    i = wp.tid()
    node = i // width
    if touched[node] != wp.uint8(0):
        lane = i - node * width
        jump = int(1)
        sum_color = float(0.0)
        sum_density = float(0.0)
        for _ in range(3):
            place = node // jump % side
            for towards in range(2):
                sign = 2 * towards - 1
                if place + sign >= 0 and place + sign < side:
                    sum_color += color[i] - color[i + sign * jump * width]
                    sum_density += density[node] - density[node + sign * jump]
            jump *= side
        d_color[i] = d_color[i] + weight_color * sum_color
        if lane == 0:
            d_density[node] = d_density[node] + weight_density * sum_density


@wp.func_native("__syncwarp();")
def sync_warp(): ...


@wp.func_native(f"""
    {STEP_ON_CUDA}
    step(gradients.data[i] * factor, mean.data[i], square.data[i], weights.data[i], learning);
    gradients.data[i] = 0.0f;
""")
def move(
    i: int,
    learning: float,
    mend: float,
    factor: float,
    beta1: float,
    beta2: float,
    epsilon: float,
    gradients: wp.array[float],
    mean: wp.array[float],
    square: wp.array[float],
    weights: wp.array[float],
): ...


@wp.kernel
def adam(
    rate_density: wp.array[float],  # (3,)
    rate_color: wp.array[float],  # (3,)
    factor: wp.array[float],  # (1,)
    beta1: float,
    beta2: float,
    epsilon: float,
    width: int,  # a divisor of 32: the threads of a node are in one warp
    # outputs
    touched: wp.array[wp.uint8],  # (N^3,): set to 0
    d_density: wp.array[float],  # (N^3,): set to 0
    density_mean: wp.array[float],
    density_square: wp.array[float],
    density: wp.array[float],
    d_color: wp.array[float],  # (N^3 C,): set to 0
    color_mean: wp.array[float],
    color_square: wp.array[float],
    color: wp.array[float],
):
    i = wp.tid()
    node = i // width
    found = touched[node]
    sync_warp()
    if found != wp.uint8(0):
        mend = 1.0 / rate_color[2]  # of both: the means of squares are as old
        move(
            i, rate_color[0] / rate_color[1], mend, factor[0], beta1, beta2, epsilon, d_color,
            color_mean, color_square, color,
        )  # fmt: skip
        if i == node * width:
            touched[node] = wp.uint8(0)
            move(
                node, rate_density[0] / rate_density[1], mend, factor[0], beta1, beta2, epsilon,
                d_density, density_mean, density_square, density,
            )  # fmt: skip
