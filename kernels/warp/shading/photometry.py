"""Normals and albedo of pixels seen under several lights, in Warp.

The Taichi set has the equations. On the CPU, least squares take 64 pixels at once, and robust rules
eight (`_photometry_cpu.h`). On CUDA a thread takes a pixel: its values stay in registers for least
squares (`_photometry_cuda.cu`), and in shared memory for robust rules under distant lights
(`_robust_cuda.cu`), if there are not too many images.
"""

import warp as wp

from cvkern.kernels.codes import shading as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._lanes_cpu import WIDE
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp.shading import _photometry_cuda
from cvkern.kernels.warp.shading._mask import is_inside
from cvkern.kernels.warp.shading._photometry_cpu import solve_lanes
from cvkern.kernels.warp.shading._robust_cuda import rank_kept, threads_for, weigh_kept

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

LEFT_OUT = wp.constant(wp.uint16(codes.LEFT_OUT))
L1 = wp.constant(int(codes.Photometric.L1))
BAYES = wp.constant(int(codes.Photometric.SPARSE_BAYES))
CONSENSUS = wp.constant(int(codes.Photometric.CONSENSUS))
RIDGE = wp.constant(wp.float64(codes.RIDGE))
FLOOR = wp.constant(wp.float64(codes.FLOOR))
NOISE = wp.constant(wp.float64(codes.SPARSE_NOISE))


@_native.kernel("_photometry_cpu.h", OPTIONS, LEFT_OUT=codes.LEFT_OUT, MOST=codes.MOST_LIGHTS)
def rank_rows(
    slab: int,
    first: int,
    last: int,
    images: wp.array3d[float],
    scales: wp.array[float],
    mask: wp.array2d[wp.uint8],
    limit: float,
    # outputs
    ranks: wp.array3d[wp.uint16],
):
    """Forward to the native code."""


@_native.kernel(
    "_photometry_cpu.h",
    OPTIONS,
    LEFT_OUT=codes.LEFT_OUT,
    MOST=codes.MOST_LIGHTS,
    L1=int(codes.Photometric.L1),
    BAYES=int(codes.Photometric.SPARSE_BAYES),
    CONSENSUS=int(codes.Photometric.CONSENSUS),
    RIDGE=codes.RIDGE,
    FLOOR=codes.FLOOR,
    NOISE=codes.SPARSE_NOISE,
)
def weigh_rows(
    slab: int,
    first: int,
    last: int,
    images: wp.array3d[float],
    ranks: wp.array3d[wp.uint16],
    lights: wp.array2d[float],
    depth: wp.array2d[float],
    windows: wp.array2d[float],
    rule: wp.vec2i,  # method and sweeps
    # outputs
    normals: wp.array3d[float],
    albedo: wp.array2d[float],
    residual: wp.array2d[float],
):
    """Forward to the native code."""


def solve(
    images: wp.array,
    inverse: wp.array,
    lights: wp.array,
    mask: wp.array,
    normals: wp.array,
    albedo: wp.array,
    residual: wp.array,
) -> None:
    """Write the least-squares solution over all images: the inverse (3, K) times each pixel."""
    inputs, outputs = [images, inverse, lights, mask], [normals, albedo, residual]
    size = albedo.size
    if albedo.device.is_cuda and images.shape[0] <= _photometry_cuda.MOST:
        _photometry_cuda.solve(inputs, outputs)
    elif albedo.device.is_cuda or size < WIDE:
        launch(_solve, size, inputs, outputs)
    else:
        solve_lanes(*inputs, *outputs)


@wp.kernel
def _solve(
    images: wp.array3d[float],  # (K, H, W)
    inverse: wp.array2d[float],  # (3, K)
    lights: wp.array2d[float],  # (K, 4)
    mask: wp.array2d[wp.uint8],
    # outputs
    normals: wp.array3d[float],
    albedo: wp.array2d[float],
    residual: wp.array2d[float],
):
    i = wp.tid()
    y = i // albedo.shape[1]
    x = i % albedo.shape[1]
    a = float(0.0)
    b = float(0.0)
    c = float(0.0)
    for k in range(images.shape[0]):
        value = images[k, y, x]
        a += inverse[0, k] * value
        b += inverse[1, k] * value
        c += inverse[2, k] * value
    total = float(0.0)
    for k in range(images.shape[0]):
        e = lights[k, 0] * a + lights[k, 1] * b + lights[k, 2] * c
        off = images[k, y, x] - wp.where(e > 0.0, e, 0.0)
        total += off * off
    length = wp.sqrt(a * a + b * b + c * c)
    if is_inside(mask, y, x) and length > 0.0 and wp.isfinite(length):
        normals[y, x, 0] = a / length
        normals[y, x, 1] = b / length
        normals[y, x, 2] = c / length
        albedo[y, x] = length
        residual[y, x] = wp.sqrt(total / float(images.shape[0]))
    else:
        for j in range(3):
            normals[y, x, j] = wp.nan
        albedo[y, x] = 0.0
        residual[y, x] = 0.0


def rank(images: wp.array, scales: wp.array, mask: wp.array, limit: float, ranks: wp.array) -> None:
    """Write how many images show a pixel darker; of equal ones the earlier is the darker.

    Images are compared after multiplication by their scales (K,). What is not finite, or `limit` or
    above, or outside of the mask, is left out.
    """
    inputs = [images, scales, mask, limit]
    size = ranks.shape[1] * ranks.shape[2]
    threads = threads_for(images.shape[0])
    if ranks.device.is_cuda and threads:
        launch(rank_kept, size, inputs, [ranks], threads)
    elif ranks.device.is_cuda:
        launch(_rank, size, inputs, [ranks])
    else:
        count = slabs(ranks.shape[1], images.shape[0] * images.size)
        launch_slabs(rank_rows, ranks.shape[1], count, inputs, [ranks])


@wp.kernel
def _rank(
    images: wp.array3d[float],
    scales: wp.array[float],
    mask: wp.array2d[wp.uint8],
    limit: float,
    # outputs
    ranks: wp.array3d[wp.uint16],
):
    i = wp.tid()
    y = i // images.shape[2]
    x = i % images.shape[2]
    for k in range(images.shape[0]):
        value = images[k, y, x]
        below = int(65535)
        if is_inside(mask, y, x) and wp.isfinite(value) and value < limit:
            below = int(0)
            value = value * scales[k]
            for j in range(images.shape[0]):
                given = images[j, y, x]
                other = given * scales[j]
                if wp.isfinite(given) and given < limit:
                    if other < value or (other == value and j < k):
                        below += 1
        ranks[k, y, x] = wp.uint16(below)


def weigh(
    images: wp.array,
    ranks: wp.array,
    lights: wp.array,
    depth: wp.array,
    windows: wp.array,
    weighing: codes.Weighing,
    normals: wp.array,
    albedo: wp.array,
    residual: wp.array,
) -> None:
    """Write the solution of a robust rule, the mean of those of several windows of ranks.

    The lights (K, 5) are a vector or a position, the strength of a near light, and the scale of the
    image.
    """
    inputs = [images, ranks, lights, depth, windows, wp.vec2i(weighing.method, weighing.sweeps)]
    outputs = [normals, albedo, residual]
    count, bayes = images.shape[0], weighing.method == codes.Photometric.SPARSE_BAYES
    if albedo.device.is_cuda and not bayes and depth.shape[0] == 0 and threads_for(count):
        threads = threads_for(count)
        given = [images, ranks, lights, windows, weighing.method, weighing.sweeps]
        blocks = -(-albedo.size // threads)
        launch(weigh_kept, blocks * threads, given, outputs, threads)
    elif albedo.device.is_cuda:
        shape = tuple(images.shape) if bayes else (1, 1, 1)
        variances = scratch("shading.variances", shape, wp.float32, images.device)
        launch(_weigh, albedo.size, inputs, [*outputs, variances])
    else:
        count = slabs(albedo.shape[0], 64 * images.size * windows.shape[0])
        launch_slabs(weigh_rows, albedo.shape[0], count, inputs, outputs)


@wp.func
def _light(lights: wp.array2d[float], depth: wp.array2d[float], k: int, y: int, x: int):
    """Return the light that reaches a pixel: the same everywhere, or from a place nearby."""
    light = wp.vec3d(wp.float64(lights[k, 0]), wp.float64(lights[k, 1]), wp.float64(lights[k, 2]))
    if depth.shape[0] > 0:
        place = wp.vec3d(wp.float64(x), -wp.float64(y), -wp.float64(depth[y, x]))
        light = light - place
        length = wp.sqrt(wp.dot(light, light))
        light = light * (wp.float64(lights[k, 3]) / (length * length * length))
    return light


@wp.func
def _value(images: wp.array3d[float], lights: wp.array2d[float], k: int, y: int, x: int):
    """Return the value of an image, times the scale of its light."""
    return wp.float64(images[k, y, x]) * wp.float64(lights[k, 4])


@wp.func
def _weight(value: wp.float64, shown: wp.float64, spread: wp.float64, method: int):
    """Return the weight of an image whose model shows `shown`, where residuals spread so far."""
    off = wp.abs(value - shown)
    weight = wp.float64(1.0)
    if spread > wp.float64(0.0):
        if method == L1:
            weight = wp.float64(1.0) / wp.max(off / spread, wp.float64(1e-3))
        elif method == CONSENSUS:
            weight = wp.float64(1.0) / (wp.float64(1.0) + (off / spread) * (off / spread))
            if shown <= wp.float64(0.0):
                weight = wp.float64(0.0)
            weight = weight + FLOOR
    return weight


@wp.kernel
def _weigh(
    images: wp.array3d[float],
    ranks: wp.array3d[wp.uint16],
    lights: wp.array2d[float],
    depth: wp.array2d[float],
    windows: wp.array2d[float],  # (M, 2): from and to, as shares of the ranks
    rule: wp.vec2i,  # method and sweeps
    # outputs
    normals: wp.array3d[float],
    albedo: wp.array2d[float],
    residual: wp.array2d[float],
    variances: wp.array3d[float],
):
    method = rule[0]
    sweeps = rule[1]
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    i = wp.tid()
    y = i // albedo.shape[1]
    x = i % albedo.shape[1]
    number = int(0)
    above = int(0)
    brightest = zero
    for k in range(images.shape[0]):
        if ranks[k, y, x] != LEFT_OUT:
            number += 1
            if images[k, y, x] > 0.0:
                above += 1
            brightest = wp.max(brightest, _value(images, lights, k, y, x))
    # A consensus leaves dark images out, but fewer than three tell no normal.
    every = method != CONSENSUS or above < 3
    mean = wp.vec3d()
    strength = zero
    total = zero
    found = number >= 3 and brightest > zero
    if depth.shape[0] > 0 and found:
        found = wp.isfinite(depth[y, x])
    for m in range(windows.shape[0]):
        if not found:
            continue
        low = int(wp.floor(windows[m, 0] * float(number) + 0.5))
        high = int(wp.floor(windows[m, 1] * float(number) + 0.5))
        inside = int(0)
        for k in range(images.shape[0]):
            r = int(ranks[k, y, x])
            if r >= low and r < high and (every or images[k, y, x] > 0.0):
                inside += 1
        if inside < 4:  # too few to tell their spread
            low = 0
            high = number
        s = wp.vec3d()
        spread = zero
        turn = zero
        for sweep in range(sweeps + 1):
            a = wp.mat33d()
            b = wp.vec3d()
            for k in range(images.shape[0]):
                r = int(ranks[k, y, x])
                value = _value(images, lights, k, y, x)
                if r >= low and r < high and (every or value > zero):
                    light = _light(lights, depth, k, y, x)
                    weight = one
                    if method == BAYES:
                        if sweep == 0:
                            variances[k, y, x] = 1.0
                        weight = one / (wp.float64(variances[k, y, x]) + NOISE)
                    elif sweep > 0:
                        weight = _weight(value, wp.dot(light, s), spread, method)
                    a += weight * wp.outer(light, light)
                    b += (weight * value) * light
            ridge = RIDGE * (a[0, 0] + a[1, 1] + a[2, 2])
            for j in range(3):
                a[j, j] = a[j, j] + ridge
            inverse = wp.inverse(a)
            old = s
            s = inverse * b
            squares = zero
            weights = zero
            for k in range(images.shape[0]):
                r = int(ranks[k, y, x])
                value = _value(images, lights, k, y, x)
                if r >= low and r < high and (every or value > zero):
                    light = _light(lights, depth, k, y, x)
                    off = value - wp.dot(light, s)
                    weight = one
                    if method == BAYES:
                        g = wp.float64(variances[k, y, x])
                        d = one / (g + NOISE)
                        lever = wp.dot(light, inverse * light)
                        e = g * d * off / brightest
                        g = g - g * g * d * (one - d * lever)
                        variances[k, y, x] = float(wp.max(e * e + g, zero))
                    elif sweep > 0:
                        weight = _weight(value, wp.dot(light, old), spread, method)
                    squares += weight * off * off
                    weights += weight
            spread = wp.sqrt(squares / wp.max(weights - wp.float64(3.0), wp.float64(0.5)))
            power = wp.dot(s, s)
            if power > zero:
                along = wp.dot(s, inverse * s) / power
                turn = (inverse[0, 0] + inverse[1, 1] + inverse[2, 2] - along) / power
        length = wp.sqrt(wp.dot(s, s))
        if length > zero and wp.isfinite(length):
            share = one
            if windows.shape[0] > 1:
                share = one / (spread * wp.sqrt(wp.max(turn, zero)) + wp.float64(1e-6))
            mean += (share / length) * s
            strength += share * length
            total += share
    length = wp.sqrt(wp.dot(mean, mean))
    if found and length > zero:
        mean = mean / length
        strength = strength / total
        squares = zero
        for k in range(images.shape[0]):
            if ranks[k, y, x] != LEFT_OUT:
                shown = strength * wp.dot(mean, _light(lights, depth, k, y, x))
                off = _value(images, lights, k, y, x) - wp.max(shown, zero)
                off = off / wp.float64(lights[k, 4])
                squares += off * off
        for j in range(3):
            normals[y, x, j] = float(mean[j])
        albedo[y, x] = float(strength)
        residual[y, x] = float(wp.sqrt(squares / wp.float64(number)))
    else:
        for j in range(3):
            normals[y, x, j] = wp.nan
        albedo[y, x] = 0.0
        residual[y, x] = 0.0
