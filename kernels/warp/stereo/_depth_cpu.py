"""Depth and points on the CPU: one thread a slab of rows, in C because it becomes vector code."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func_native("""
    const int columns = depth.shape[1];
    const float* from = disparity.data + (size_t)row * columns;
    float* to = depth.data + (size_t)row * columns;
    const float infinite = __builtin_inff(), none = __builtin_nanf("");
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < columns; ++x) {
        const float sum = from[x] + doffs;
        const float beyond = sum == 0.0f ? infinite : none;
        const float quotient = scale / sum;
        to[x] = sum > 0.0f && sum < infinite ? quotient : beyond;
    }
""")
def depth_row(
    disparity: wp.array2d[float], row: int, scale: float, doffs: float, depth: wp.array2d[float]
): ...


@wp.kernel
def depth(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    scale: float,
    doffs: float,
    # outputs
    depth: wp.array2d[float],  # (H, W)
):
    for row in range(first, last):
        depth_row(disparity, row, scale, doffs, depth)


# Products and sums in the order of `reprojected` in _depth_cuda.py, and none of them fused.
@wp.func_native("""
    #pragma clang fp contract(off)
    const int columns = points.shape[1];
    const float* from = disparity.data + (size_t)row * columns;
    float* to = points.data + (size_t)row * columns * 3;
    const float none = __builtin_nanf(""), infinite = __builtin_inff(), y = (float)row;
    float m[16];
    for (int i = 0; i < 16; ++i) m[i] = q.data[i];
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < columns; ++x) {
        const float d = from[x], u = (float)x;
        const float a = m[0] * u + m[1] * y + m[2] * d + m[3];
        const float b = m[4] * u + m[5] * y + m[6] * d + m[7];
        const float c = m[8] * u + m[9] * y + m[10] * d + m[11];
        const float w = m[12] * u + m[13] * y + m[14] * d + m[15];
        const bool exists = __builtin_fabsf(d) < infinite && w != 0.0f;
        const float p = a / w, s = b / w, t = c / w;
        to[3 * x] = exists ? p : none;
        to[3 * x + 1] = exists ? s : none;
        to[3 * x + 2] = exists ? t : none;
    }
""")
def points_row(
    disparity: wp.array2d[float], row: int, q: wp.array2d[float], points: wp.array3d[float]
): ...


@wp.kernel
def points(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    q: wp.array2d[float],  # (4, 4)
    # outputs
    points: wp.array3d[float],  # (H, W, 3)
):
    for row in range(first, last):
        points_row(disparity, row, q, points)
